"""Offsets put into the chip: `run` puts them there again, nothing is corrected twice, and no failure is silent."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from imu_run import run_for
from session_rig import Bench

from hw_fakes import NOISE_ONLY, FakeBus, FakeMpu6050, Still
from hw_fakes.chip import personalities as fakes
from quavelet.bench.chip_offsets import write_offsets
from quavelet.bench.session import USUAL
from quavelet.bench.session_result import work_out
from quavelet.bench.session_verdict import verdict
from quavelet.calibration.model import IDENTITY, NO_MATRIX
from quavelet.calibration.record import AccelerometerTable, CalibrationRecord, GyroBiasTable, Made
from quavelet.calibration.record_file import file_name, load_record, save_record
from quavelet.core.blocks import Flag
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import CalibrationError, ChipUnstable, DeviceMissing, ImuError
from quavelet.core.instruction import FACES, Instruction
from quavelet.core.units import DEG_PER_RAD, NS_PER_S, RAD_PER_DEG, STANDARD_GRAVITY_M_S2
from quavelet.imu import Imu
from quavelet.settings import CalibrationSettings, LoopSettings, OffsetSettings, Settings

OFF_G, OFF_DPS = np.array([0.043, -0.0171, 0.0793]), np.array([-7.3, 2.71, 15.9])
BOARD = replace(
    NOISE_ONLY,
    accel_bias_m_s2=tuple((STANDARD_GRAVITY_M_S2 * OFF_G).tolist()),
    gyro_bias_rad_s=tuple((RAD_PER_DEG * OFF_DPS).tolist()),
)
SETTINGS = Settings(loop=LoopSettings(rate_hz=20.0))
CHIPS = {chip.name: chip for chip in fakes.PERSONALITIES}
ACCEL_STEP_G, GYRO_STEP_DPS = 2 / 2048, 1 / 32.8


class Board:
    """A board at rest, its chip, and the record of what is wrong with it, as a session would have found it."""

    def __init__(self, name="MPU-6050", *, motion=None, bus=FakeBus, parts=("accelerometer", "gyro_bias")):
        self.clock, self.personality = VirtualClock(5 * NS_PER_S), CHIPS[name]
        self.chip = FakeMpu6050(
            self.clock,
            motion=motion or Still(roll_deg=12.0),
            imperfections=BOARD,
            personality=self.personality,
            seed=4,
        )
        self.bus = bus({0x68: self.chip}, clock=self.clock, name="fake:board")
        self.factory = self.words()
        self.heard = []
        imu = self.imu(SETTINGS)
        tables = {"accelerometer": accelerometer(), "gyro_bias": gyro_bias()}
        self.record = CalibrationRecord(
            chip=imu.identity(imu.source.wait_until_streaming()),
            made=Made(
                utc="2026-01-02T03:04:05Z",
                version="0.1.0",
                gyro_range_dps=500,
                accel_range_g=4,
                lowest_degc=20.0,
                highest_degc=40.0,
            ),
            **{part: tables[part] for part in parts},
        )

    def imu(self, settings) -> Imu:
        return Imu(self.bus, settings=settings, clock=self.clock, on_note=self.heard.append)

    def words(self):
        """What stands in the offset registers, accelerometer and gyroscope."""
        held, places = self.chip.registers, (*self.personality.accel_offsets, 0x13, 0x15, 0x17)
        return tuple(int.from_bytes(held[at : at + 2], "big", signed=True) for at in places)

    def write(self):
        return write_offsets(
            self.bus, self.record, settings=SETTINGS, clock=self.clock, tell=self.heard.append
        )  # fmt: skip


def accelerometer() -> AccelerometerTable:
    return AccelerometerTable(
        offset_m_s2=BOARD.accel_bias_m_s2,
        offset_sigma_m_s2=(0.002, 0.002, 0.002),
        matrix=IDENTITY,
        matrix_sigma=((1e-4,) * 3,) * 3,
        frame="sensor",
        undetermined=(),
        sigma_m_s2=0.005,
        rms_before_g=0.03,
        rms_after_g=0.001,
        residual_g=(0.0,),
    )


def gyro_bias() -> GyroBiasTable:
    return GyroBiasTable(
        reference_degc=30.0,
        coefficients_rad_s=(BOARD.gyro_bias_rad_s,),
        lowest_degc=20.0,
        highest_degc=40.0,
        sigma_rad_s=1e-4,
        slope_sigma_rad_s_degc=0.0,
        per_force_rad_s=NO_MATRIX,
        residual_rms_rad_s=1e-5,
    )


@pytest.fixture(scope="module")
def written() -> tuple[Board, CalibrationRecord]:
    """A board with its offsets in the chip; each start of it resets the chip."""
    board = Board()
    return board, board.write()[0]


def assert_right(block):
    assert np.linalg.norm(block.accel_m_s2.mean(axis=0)) == pytest.approx(STANDARD_GRAVITY_M_S2, rel=1e-3)
    assert np.abs(block.gyro_rad_s.mean(axis=0)).max() * DEG_PER_RAD < 0.05


@pytest.mark.parametrize(
    "name",
    ["MPU-6050", "MPU-6500", *(pytest.param(name, marks=pytest.mark.slow) for name in ("MPU-6050-early", "ICM-20689"))],
)
def test_the_chip_takes_the_offsets_and_the_record_keeps_what_they_leave(name):
    board = Board(name)
    record, finding = board.write()
    assert finding.ok
    held, told = board.words(), record.offsets
    assert (told.accel + told.gyro, told.accel_factory + told.gyro_factory) == (held, board.factory)
    assert [word & 1 for word in held[:3]] == [word & 1 for word in board.factory[:3]]
    assert np.array(held[:3]) - board.factory[:3] == pytest.approx(-2048 * OFF_G, abs=1.0)
    assert held[3:] == pytest.approx(-32.8 * OFF_DPS, abs=0.5)
    left_g = np.array(record.accelerometer.offset_m_s2) / STANDARD_GRAVITY_M_S2
    left_dps = DEG_PER_RAD * np.array(record.gyro_bias.coefficients_rad_s[0])
    assert np.abs(left_g).max() <= 0.5 * ACCEL_STEP_G
    assert np.abs(left_dps).max() <= 0.5 * GYRO_STEP_DPS
    assert left_g - (np.array(held[:3]) - board.factory[:3]) / 2048 == pytest.approx(OFF_G, abs=1e-9)
    assert left_dps - np.array(held[3:]) / 32.8 == pytest.approx(OFF_DPS, abs=1e-9)


@pytest.mark.parametrize("name", ["MPU-6050", pytest.param("MPU-6500", marks=pytest.mark.slow)])
def test_run_writes_them_after_every_reset_and_corrects_once(name, tmp_path):
    board = Board(name)
    record, _ = board.write()
    save_record(record, tmp_path / "c.toml")
    board.chip.power_cut()
    assert board.words() == board.factory
    settings = msgspec.structs.replace(SETTINGS, calibration=CalibrationSettings(file=str(tmp_path / "c.toml")))
    imu = board.imu(settings)
    before = run_for(imu, 3.0)
    assert board.words() == record.offsets.accel + record.offsets.gyro
    assert board.heard[-1].endswith("with offsets in the chip")
    assert imu.identity(imu.source.info) == record.chip
    assert_right(before[200:])
    board.chip.power_cut()
    after = run_for(imu, 3.0)
    assert imu.health.chip_restarts == 1
    assert board.words() == record.offsets.accel + record.offsets.gyro
    assert_right(after)
    # Not one sample of the chip without its offsets comes through.
    trusted = after[(after.flags & Flag.GAP) == 0]
    assert np.abs(trusted.gyro_rad_s).max() * DEG_PER_RAD < 1.0


def test_a_record_with_offsets_is_found_by_the_chip_that_holds_them_still(tmp_path, monkeypatch, written):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    board, record = written
    save_record(record, tmp_path / "quavelet" / "calibration" / file_name(record.chip))
    imu = board.imu(SETTINGS)
    assert_right(run_for(imu, 3.0)[200:])
    assert imu.calibration == record


def test_only_what_was_calibrated_is_written():
    board = Board(parts=("gyro_bias",))
    record, _ = board.write()
    assert record.offsets.accel == record.offsets.accel_factory == board.words()[:3]
    assert record.accelerometer is None
    assert board.words()[3:] == pytest.approx(-32.8 * OFF_DPS, abs=0.5)


def test_offsets_of_the_settings_beside_those_of_the_record_are_no_calibration(tmp_path, written):
    board, record = written
    save_record(record, tmp_path / "c.toml")
    accel, gyro = record.offsets.accel_factory, record.offsets.gyro_factory
    others = OffsetSettings(who_am_i=0x68, accel_factory=accel, gyro_factory=gyro, accel=accel, gyro=(1, 2, 3))
    settings = msgspec.structs.replace(
        SETTINGS, offsets=others, calibration=CalibrationSettings(file=str(tmp_path / "c.toml"))
    )
    with pytest.raises(CalibrationError, match="other words in the chip's offset registers"):
        run_for(board.imu(settings), 1.0)


def test_a_record_whose_words_no_chip_can_hold_is_refused_by_its_path(tmp_path, written):
    board, record = written
    x, y, z = record.offsets.accel
    bent = msgspec.structs.replace(record, offsets=msgspec.structs.replace(record.offsets, accel=(x ^ 1, y, z)))
    save_record(bent, tmp_path / "c.toml")
    settings = msgspec.structs.replace(SETTINGS, calibration=CalibrationSettings(file=str(tmp_path / "c.toml")))
    with pytest.raises(CalibrationError, match=r"c\.toml.*bit 0"):
        run_for(board.imu(settings), 1.0)


class RestlessUntil:
    """A board that is in a hand until a time of its own, then lies."""

    def __init__(self, at_s):
        self.at_s = at_s

    def rate_rad_s(self, t_s):
        return np.where((t_s < self.at_s)[:, None], np.sin(9.0 * t_s)[:, None] * [0.3, 0.2, 0.1], 0.0)

    def specific_force_m_s2(self, t_s):
        return Still().specific_force_m_s2(t_s)


def test_a_board_in_a_hand_is_waited_for():
    board = Board(motion=RestlessUntil(12.0))
    _, finding = board.write()
    assert finding.ok
    assert board.clock.now_ns() > 12 * NS_PER_S


class Knocked(RestlessUntil):
    """At rest, but for a second."""

    def rate_rad_s(self, t_s):
        return np.where((np.abs(t_s - self.at_s) < 0.5)[:, None], [0.5, 0.5, 0.5], 0.0)


def test_a_knock_while_they_are_written_is_told_and_it_is_tried_once_more():
    board = Board(motion=Knocked(12.0))
    record, finding = board.write()
    assert finding.ok
    assert any("the board move" in said and said.endswith("it is tried once more") for said in board.heard)
    assert record.offsets.gyro == pytest.approx(-32.8 * OFF_DPS, abs=0.5)


def test_a_chip_that_takes_no_offsets_is_told_and_is_left_with_the_factorys():
    board = Board()

    def deaf(words):
        factory = [word & ~1 for word in board.factory[:3]]
        held = board.words()
        accel = [8 * ((word & ~1) - was) for word, was in zip(held[:3], factory, strict=True)]
        return (words - np.round([*accel, 0, *(131 / 32.8 * np.array(held[3:]))])).astype(np.int16)

    board.chip.spoil_words = deaf
    with pytest.raises(CalibrationError, match="leave them out and calibrate in software"):
        board.write()
    assert board.words() == board.factory


class Forgetful(FakeBus):
    """What is written to the gyroscope's offset register does not stay."""

    def write(self, address: int, data: bytes) -> None:
        super().write(address, bytes([data[0], 0]) if data[0] == 0x14 else data)


def test_words_that_do_not_read_back_are_an_error():
    board = Board(bus=Forgetful)
    with pytest.raises(ChipUnstable, match="did not read back as written"):
        board.write()


class Pulled(FakeBus):
    """The plug comes off at the first word that is not the factory's."""

    def write(self, address: int, data: bytes) -> None:
        if data[0] == 0x14 and data[1]:
            self.targets[address].unplug()
        super().write(address, data)


def test_a_plug_pulled_while_they_are_written_is_an_error_and_the_next_start_is_right(tmp_path):
    board = Board(bus=Pulled)
    save_record(board.record, tmp_path / "c.toml")
    with pytest.raises(ImuError) as told:
        board.write()
    assert isinstance(told.value, DeviceMissing)
    board.chip.plug()
    settings = msgspec.structs.replace(SETTINGS, calibration=CalibrationSettings(file=str(tmp_path / "c.toml")))
    assert load_record(tmp_path / "c.toml").offsets is None
    assert_right(run_for(board.imu(settings), 3.0)[200:])
    assert board.words() == board.factory


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 106))
def test_a_drawn_board_with_its_offsets_in_the_chip_is_as_right_as_one_without(seed, tmp_path):
    bench = Bench(USUAL, out=tmp_path / "s", seed=seed)
    assert bench.conduct()
    result = work_out(bench.evidence, utc="2026-01-01T00:00:00Z", version="0")
    assert all(finding.ok for finding in verdict(result))
    record, _ = write_offsets(bench.bus, result.record, settings=SETTINGS, clock=bench.clock, tell=lambda _: None)
    save_record(record, tmp_path / "c.toml")
    settings = msgspec.structs.replace(SETTINGS, calibration=CalibrationSettings(file=str(tmp_path / "c.toml")))
    imu = Imu(bench.bus, settings=settings, clock=bench.clock)
    for face in FACES:
        bench.bus.follow(Instruction(action="face", face=face))
        block = run_for(imu, 5.0)[-200:]
        at_s = np.array([bench.bus.chip.world_time_s(bench.clock.now_ns())])
        true, found = bench.bus.motion.specific_force_m_s2(at_s)[0], block.accel_m_s2.mean(axis=0)
        cosine = true @ found / np.linalg.norm(true) / np.linalg.norm(found)
        tilt_deg = DEG_PER_RAD * np.arccos(min(cosine, 1.0))
        rate_dps = DEG_PER_RAD * np.abs(block.gyro_rad_s.mean(axis=0)).max()
        print(f"{seed} {face} tilt {tilt_deg:.3f} deg, rate {rate_dps:.4f} deg/s")
        assert tilt_deg < 0.3
        assert np.linalg.norm(found) == pytest.approx(STANDARD_GRAVITY_M_S2, rel=3e-3)
        assert rate_dps < 0.05


class Interrupted(FakeBus):
    """Ctrl-C comes at the first word that is not the factory's, once."""

    pressed = False

    def write(self, address: int, data: bytes) -> None:
        super().write(address, data)
        if data[0] == 0x14 and data[1] and not self.pressed:
            self.pressed = True
            raise KeyboardInterrupt


def test_ctrl_c_while_they_are_written_leaves_no_words_of_a_trial_in_the_chip():
    board = Board(bus=Interrupted)
    with pytest.raises(KeyboardInterrupt):
        board.write()
    assert board.words() == board.factory
