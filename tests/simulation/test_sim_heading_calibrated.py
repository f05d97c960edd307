"""A magnetometer with hard and soft iron: calibrated on the bench, found by the chip, and the heading is right."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from test_sim_heading import DECLINATION_DEG, BesideAMagnet

from hw_fakes import NOISE_ONLY, FakeBus, FakeMpu6050, board
from hw_fakes.magnetometers.base import MagnetometerImperfections
from quavelet.attitude.heading import HeadingParams
from quavelet.calibration.accelerometer import sphere_points
from quavelet.calibration.magnetometer import fit_magnetometer
from quavelet.calibration.record import CalibrationRecord, ChipIdentity, Made, magnetometer_table
from quavelet.calibration.record_file import save_record
from quavelet.core.clock import VirtualClock
from quavelet.core.euler import to_euler
from quavelet.core.units import NS_PER_S
from quavelet.imu import Imu
from quavelet.mpu6050.config import ChipConfig
from quavelet.mpu6050.magnetometer.asked import MagnetometerParams
from quavelet.settings import CalibrationSettings, LoopSettings, Settings

BOARD = board("gy-87-hmc5883l")
BUS = "fake:table"
IRON = MagnetometerImperfections(
    hard_iron_ut=(14.0, -22.0, 9.0),
    soft_iron=((1.12, 0.05, -0.03), (0.05, 0.90, 0.04), (-0.03, 0.04, 1.0)),
    noise_ut=0.3,
)
BY_HAND = HeadingParams(hard_iron_ut=(0.0, 0.0, 0.0))


def saved(path: Path, iron: MagnetometerImperfections = IRON) -> Path:
    """The calibration of a magnetometer that was turned through all directions, as the chip's file."""
    rng = np.random.default_rng(1)
    field = 48.0 * sphere_points(600) @ np.array(iron.soft_iron).T + iron.hard_iron_ut
    mounting = np.array(BOARD.mounting)
    table = magnetometer_table(fit_magnetometer((field + rng.normal(0.0, iron.noise_ut, field.shape)) @ mounting))
    record = CalibrationRecord(
        chip=ChipIdentity(who_am_i=0x68, name="MPU-6050", bus=BUS, address=0x68),
        made=Made(
            utc="2026-01-01T00:00:00Z", version="0", gyro_range_dps=500, accel_range_g=4,
            lowest_degc=0.0, highest_degc=60.0,
        ),
        magnetometer=table,
    )  # fmt: skip
    save_record(record, path)
    return path


class Ran:
    """A board on a turntable: the yaw of its messages, and the truth."""

    def __init__(self, *, file: str = "", heading: HeadingParams = HeadingParams(), **motion: float) -> None:  # noqa: B008
        clock, moves = VirtualClock(5 * NS_PER_S), BesideAMagnet(axis_tilt_deg=10.0, turn_deg=350.0, **motion)
        aux = BOARD.aux_master(clock, moves, imperfections=IRON)
        chip = FakeMpu6050(clock, motion=moves, imperfections=NOISE_ONLY, personality=BOARD.personality, aux=aux)
        self.notes: list[str] = []
        imu = Imu(
            FakeBus({0x68: chip, **aux.outside()}, clock=clock, name=BUS),
            settings=Settings(
                chip=ChipConfig(gyro_range_dps=500, accel_range_g=4, dlpf=3, sample_rate_hz=100.0),
                loop=LoopSettings(rate_hz=50.0),
                magnetometer=MagnetometerParams(use="auto"),
                calibration=CalibrationSettings(file=file),
                heading=heading,
            ),
            clock=clock,
            on_note=self.notes.append,
        )
        messages = list(imu.messages(until_ns=clock.now_ns() + 14 * NS_PER_S))
        world_s = np.array([chip.world_time_s(message.t_ns) for message in messages])
        truth = np.degrees(to_euler(moves.attitude(world_s))[:, 2])
        error = np.array([message.yaw_deg for message in messages]) - truth - DECLINATION_DEG
        self.fixed = np.array([message.yaw == "magnetic" for message in messages])
        self.disturbed = np.array(["field_disturbed" in message.flags for message in messages])
        self.error_deg = np.abs((error + 180.0) % 360.0 - 180.0)
        self.sigma_deg = np.array([message.sigma_deg[2] for message in messages])


def test_the_chips_calibration_takes_its_iron_out_of_the_heading(tmp_path):
    before = Ran(heading=BY_HAND)
    after = Ran(file=str(saved(tmp_path / "chip.toml")))
    print(
        f"heading error at most: {before.error_deg[before.fixed].max():.1f} deg before,"
        f" {after.error_deg[after.fixed].max():.2f} deg after, said to be {np.median(after.sigma_deg):.2f}"
    )
    assert after.notes[0].endswith("; heading is by its magnetometer")
    assert after.fixed.mean() > 0.6
    assert after.error_deg[after.fixed].max() < 2.0
    assert not before.fixed.any() or before.error_deg[before.fixed].max() > 15.0
    assert (after.error_deg < 3.0 * after.sigma_deg)[after.fixed].all()
    # Mostly the tilt of an accelerometer that is not calibrated, in a steep field.
    assert np.median(after.sigma_deg[after.fixed]) < 6.0


def test_settings_go_before_the_chips_calibration_and_say_so(tmp_path):
    wrong = HeadingParams(hard_iron_ut=IRON.hard_iron_ut, hard_iron_sigma_ut=5.0)
    ran = Ran(file=str(saved(tmp_path / "chip.toml")), heading=wrong)
    assert "[heading] of the settings, which goes before" in ran.notes[0]
    assert ran.error_deg[ran.fixed].max() > 2.0


def test_a_magnet_that_is_there_from_the_start_gives_no_first_heading(tmp_path):
    path = str(saved(tmp_path / "chip.toml"))
    ran = Ran(file=path, laid_s=-10.0, taken_s=9.0)
    early = np.flatnonzero(ran.fixed)[0]
    assert ran.disturbed[:early].any()
    assert ran.error_deg[ran.fixed].max() < 3.0
