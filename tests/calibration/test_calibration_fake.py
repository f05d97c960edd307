"""A calibration on the fake chip, through its registers: measured, saved, found again by the chip, and of use."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest
from imu_run import run_for
from msgspec import structs

from hw_fakes import FakeBus, FakeMpu6050, Still, Sway
from hw_fakes.world.imperfections import TYPICAL
from hw_fakes.world.motion_carried import Walk
from quavelet.attitude.params import FilterParams
from quavelet.calibration.calibrate import Calibrate
from quavelet.calibration.gyro_bias import fit_gyro_bias
from quavelet.calibration.model import UNCALIBRATED
from quavelet.calibration.poses import PoseCollector
from quavelet.calibration.record import AccelerometerTable, CalibrationRecord, GyroBiasTable, Made, gyro_bias_table
from quavelet.calibration.record_file import as_toml, file_name, save_record
from quavelet.core.blocks import AttitudeBlock, Flag, concat
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import CalibrationError
from quavelet.core.euler import to_euler
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S
from quavelet.imu import Imu
from quavelet.pipeline import build_pipeline
from quavelet.recording.reader import RecordingReader
from quavelet.recording.replay import ReplaySource
from quavelet.recording.writer import RecordingWriter
from quavelet.settings import CalibrationSettings, LoopSettings, Settings

SLOPE_DPS_DEGC = 0.02
WARMING = replace(
    TYPICAL,
    gyro_bias_rad_s_degc=tuple(np.radians([SLOPE_DPS_DEGC, -SLOPE_DPS_DEGC, SLOPE_DPS_DEGC]).tolist()),
    gyro_scale=(1.0, 1.0, 1.0),
    temp_degc=16.0,
    warm_temp_degc=38.0,
    warm_up_s=150.0,
)
SETTINGS = Settings(
    chip=structs.replace(Settings().chip, sample_rate_hz=50.0, dlpf=4),
    filter=FilterParams(kind="pid"),
    loop=LoopSettings(rate_hz=5.0),
)
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The user's calibrations, none yet."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path / "quavelet" / "calibration"


def imu_on(motion, *, board=WARMING, settings=SETTINGS, trim=None, notes=None, clock=None, **ways) -> Imu:
    clock = clock or VirtualClock()
    chip = FakeMpu6050(clock, motion=motion, imperfections=board, seed=3, **({"accel_trim": trim} if trim else {}))
    bus = FakeBus({0x68: chip}, clock=clock, name="fake:bench")
    return Imu(bus, settings=settings, clock=clock, on_note=None if notes is None else notes.append, **ways)


def made_for(imu: Imu, **tables) -> CalibrationRecord:
    info = imu.source.wait_until_streaming()
    return CalibrationRecord(
        chip=imu.identity(info),
        made=Made(
            utc="2026-01-02T03:04:05Z", version="0.1.0", gyro_range_dps=500, accel_range_g=4,
            lowest_degc=16.0, highest_degc=38.0,
        ),
        **tables,
    )  # fmt: skip


def good_accelerometer() -> AccelerometerTable:
    return AccelerometerTable(
        offset_m_s2=(0.1961, -0.1177, 0.3432), offset_sigma_m_s2=(0.003, 0.003, 0.003), matrix=IDENTITY,
        matrix_sigma=((1e-3,) * 3,) * 3, frame="sensor", undetermined=(), sigma_m_s2=0.015,
        rms_before_g=0.02, rms_after_g=0.0003, residual_g=(0.0,),
    )  # fmt: skip


def heading_error_deg(imu: Imu, out: AttitudeBlock) -> np.ndarray:
    t_s = np.array([imu.bus.targets[0x68].world_time_s(int(t)) for t in out.t_ns])
    truth = imu.bus.targets[0x68].motion.attitude(t_s)
    error = np.unwrap(to_euler(out.q)[:, 2] - to_euler(truth)[:, 2])
    return np.degrees(error - error[np.searchsorted(t_s, 5.0)])


def test_a_temperature_run_takes_the_drift_of_the_bias_and_of_heading_away(folder):
    """Bars: residual bias below 0.02 deg/s over 20 degC, and a tenth of the heading's drift in ten minutes."""
    imu, collector, calibrate = imu_on(Still()), PoseCollector(), Calibrate(UNCALIBRATED)
    imu.source.wait_until_streaming()
    poses = []
    for _ in imu.loop.deadlines(imu.clock.now_ns() + 600 * NS_PER_S):
        poses += collector.process(calibrate.process(imu.source.read()))
    fit = fit_gyro_bias(poses)
    assert fit.highest_degc - fit.lowest_degc > 20.0
    chip = imu.bus.targets[0x68]
    t_s = np.linspace(10.0, 590.0, 100)
    residual = chip.source.imperfections.gyro_error_rad_s(t_s) - fit.curve().at(WARMING.temperature_degc(t_s))
    # What force does is no part of this board: the pose shows the bias as a whole.
    residual -= np.array(fit.per_force) @ np.array(poses[0].accel_m_s2)
    assert np.abs(np.degrees(residual)).max() < 0.02
    record = made_for(imu, gyro_bias=gyro_bias_table(fit))

    drift, sigma = {}, {}
    for name in ("uncalibrated", "calibrated"):
        if name == "calibrated":
            save_record(record, folder / file_name(record.chip))
        walker = imu_on(Walk())
        out = run_for(walker, 600.0)
        assert (walker.calibration is not None) == (name == "calibrated")
        drift[name] = np.abs(heading_error_deg(walker, out)).max()
        sigma[name] = float(np.degrees(out.sigma_rad[-1, 2]))
        assert drift[name] < 4.0 * sigma[name]
    print(
        f"\nresidual bias {np.abs(np.degrees(residual)).max():.4f} deg/s over {fit.highest_degc - fit.lowest_degc:.1f} "
        f"degC (it moved {SLOPE_DPS_DEGC * (fit.highest_degc - fit.lowest_degc):.2f}); heading after 10 min off by "
        f"{drift['uncalibrated']:.1f} -> {drift['calibrated']:.2f} deg, sigma {sigma['uncalibrated']:.0f} -> "
        f"{sigma['calibrated']:.1f} deg"
    )
    assert drift["calibrated"] < 0.1 * drift["uncalibrated"]


@pytest.mark.parametrize("kind", ["pid", "gated"])
def test_a_board_that_moves_from_the_start_has_its_bias_from_its_temperature(folder, kind):
    settings = structs.replace(SETTINGS, filter=FilterParams(kind=kind), loop=LoopSettings(rate_hz=50.0))
    plain = run_for(imu_on(Sway(), settings=settings), 10.0)
    assert ((plain.flags & Flag.BIAS_UNKNOWN) != 0).all()
    true = np.array([WARMING.gyro_bias_rad_s, WARMING.gyro_bias_rad_s_degc])
    curve = GyroBiasTable(
        reference_degc=25.0, coefficients_rad_s=tuple(map(tuple, true.tolist())), lowest_degc=16.0, highest_degc=38.0,
        sigma_rad_s=1e-3, slope_sigma_rad_s_degc=1e-5, per_force_rad_s=((0.0,) * 3,) * 3, residual_rms_rad_s=1e-5,
    )  # fmt: skip
    record = made_for(imu_on(Sway()), gyro_bias=curve)
    save_record(record, folder / file_name(record.chip))
    out = run_for(imu_on(Sway(), settings=settings), 10.0)
    assert not (out.flags[20:] & Flag.BIAS_UNKNOWN).any()
    assert out.sigma_rad[-1, 2] < 0.1 * plain.sigma_rad[-1, 2]
    assert np.abs(np.degrees(out.gyro_bias_rad_s[-1])).max() < 0.2


def test_a_calibrated_accelerometer_is_believed_and_right(folder):
    flat = Still(roll_deg=0.0, pitch_deg=0.0)
    plain = run_for(imu_on(flat), 8.0)
    imu = imu_on(flat)
    record = made_for(imu, accelerometer=good_accelerometer())
    save_record(record, folder / file_name(record.chip))
    notes: list[str] = []
    calibrated_imu = imu_on(flat, notes=notes)
    calibrated = run_for(calibrated_imu, 8.0)
    assert notes == [f"calibration of 2026-01-02T03:04:05Z from {folder / file_name(record.chip)}"]
    before, after = (np.degrees(block.sigma_rad[-1, 0]) for block in (plain, calibrated))
    assert before > 2.0
    assert after < 0.15
    off = [np.abs(np.degrees(to_euler(block.q[-1:])[0, :2])).max() for block in (plain, calibrated)]
    assert off[0] > 0.5
    assert off[1] < 0.1


def test_a_chip_of_the_same_kind_does_not_get_the_calibration_of_another(folder):
    record = made_for(imu_on(Still()), accelerometer=good_accelerometer())
    save_record(record, folder / file_name(record.chip))
    other = imu_on(Still(), trim=(-1201, 3015, 1777))
    run_for(other, 1.0)
    assert other.calibration is None


@pytest.mark.parametrize("damage", ["cut", "changed", "range"])
def test_a_file_that_does_not_fit_is_told_of_and_not_used_unless_it_was_asked_for(folder, damage):
    record = made_for(imu_on(Still()), accelerometer=good_accelerometer())
    path = folder / file_name(record.chip)
    settings = SETTINGS
    save_record(record, path)
    if damage == "range":
        settings = structs.replace(SETTINGS, chip=structs.replace(SETTINGS.chip, gyro_range_dps=1000))
    else:
        text = as_toml(record)
        path.write_text(text[:300] if damage == "cut" else text.replace("0.1961", "0.0961"))
    notes: list[str] = []
    imu = imu_on(Still(), settings=settings, notes=notes)
    run_for(imu, 1.0)
    assert imu.calibration is None
    (note,) = notes
    assert note.startswith(f"no calibration is used: {path}: ")
    named = structs.replace(settings, calibration=CalibrationSettings(file=str(path)))
    with pytest.raises(CalibrationError, match=path.name):
        run_for(imu_on(Still(), settings=named), 1.0)


def test_a_recording_is_replayed_with_the_calibration_it_was_made_with(folder, tmp_path):
    made = imu_on(Still())
    record = made_for(made, accelerometer=good_accelerometer())
    save_record(record, folder / file_name(record.chip))
    path, clock = tmp_path / "a.qrec", VirtualClock()
    with RecordingWriter(path, settings=SETTINGS, clock=clock) as writer:
        imu = imu_on(Still(), clock=clock, on_stream=writer.begin, on_drain=writer.write)
        writer.calibration = lambda: imu.calibration_text
        live = run_for(imu, 4.0)
    replay = ReplaySource(RecordingReader(path), health=Health())
    assert replay.calibration == record.calibration()
    pipeline = build_pipeline(replay.settings, calibration=replay.calibration)
    again = []
    while (block := replay.read()) is not None:
        again.append(pipeline.process(block))
    assert concat(again).q.tobytes() == live.q.tobytes()
    assert concat(again).accel_m_s2.tobytes() == live.accel_m_s2.tobytes()


def test_the_search_can_be_switched_off(folder):
    record = made_for(imu_on(Still()), accelerometer=good_accelerometer())
    save_record(record, folder / file_name(record.chip))
    off = imu_on(Still(), settings=structs.replace(SETTINGS, calibration=CalibrationSettings(automatic=False)))
    run_for(off, 1.0)
    assert off.calibration is None


def test_a_chip_hotter_than_it_was_calibrated_says_so(folder):
    record = made_for(imu_on(Still()), accelerometer=good_accelerometer())
    record = structs.replace(record, made=structs.replace(record.made, lowest_degc=20.0, highest_degc=22.0))
    save_record(record, folder / file_name(record.chip))
    hot = replace(WARMING, temp_degc=26.0, warm_temp_degc=30.0, warm_up_s=5.0)
    out = run_for(imu_on(Still(), board=hot), 10.0)
    flagged = (out.flags & Flag.UNCALIBRATED_TEMPERATURE) != 0
    assert not flagged[:10].any()
    assert flagged[-100:].all()


def test_the_trim_is_only_read_and_only_where_there_is_a_calibration_to_be_found(folder):
    def written_and_read(imu: Imu) -> list[bytes]:
        seen: list[bytes] = []
        real = imu.bus.write_read

        def spy(address: int, data: bytes, n: int) -> bytes:
            seen.append(data)
            return real(address, data, n)

        imu.bus.write_read = spy  # type: ignore[method-assign]
        run_for(imu, 1.0)
        return seen

    trims = {struct.pack("B", register) for register in (0x06, 0x08, 0x0A, 0x0D, 0x13, 0x15, 0x17)}
    none = set(written_and_read(imu_on(Still())))
    record = made_for(imu_on(Still()), accelerometer=good_accelerometer())
    save_record(record, folder / file_name(record.chip))
    some = set(written_and_read(imu_on(Still())))
    assert some - none <= trims
    assert struct.pack("B", 0x0D) in some - none
