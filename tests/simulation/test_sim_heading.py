"""From the fake magnetometer's registers to the heading in the message, over a turn, a magnet and a brown-out."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
import pytest
from session import Session, run_session

from hw_fakes import NOISE_ONLY, FakeBus, FakeMpu6050, Turntable, board
from hw_fakes.faults.plan import parse
from hw_fakes.magnetometers.base import TYPICAL_MAGNETOMETER
from hw_fakes.world.motion_base import to_body
from quavelet.attitude.heading import HeadingParams
from quavelet.core.blocks import Flag, YawFrom
from quavelet.core.clock import VirtualClock
from quavelet.core.euler import to_euler
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050.config import ChipConfig
from quavelet.mpu6050.magnetometer.asked import MagnetometerParams
from quavelet.settings import LoopSettings, Settings
from quavelet.sinks.message import message_of

BOARDS = ["gy-87", "gy-87-hmc5883l", "mpu-9150", "mpu-9250"]
DECLINATION_DEG = 4.0  # of `EarthField`


@dataclass(frozen=True, slots=True)
class BesideAMagnet(Turntable):
    """A magnet is laid beside the table for a while, which turns the horizontal field by 60 degrees."""

    laid_s: float = np.inf
    taken_s: float = np.inf

    def magnetic_field_ut(self, t_s):
        there = (t_s >= self.laid_s) & (t_s < self.taken_s)
        magnet = to_body(self.attitude(t_s), there[:, None] * np.array([35.0, 0.0, 0.0]))
        return Turntable.magnetic_field_ut(self, t_s) + magnet


def calibration(mounting, **others) -> HeadingParams:
    """What takes TYPICAL_MAGNETOMETER's errors out, in the body frame."""
    to_body_m = np.array(mounting).T
    hard = to_body_m @ TYPICAL_MAGNETOMETER.hard_iron_ut
    soft = np.linalg.inv(to_body_m @ np.array(TYPICAL_MAGNETOMETER.soft_iron) @ to_body_m.T)
    return HeadingParams(hard_iron_ut=tuple(hard.tolist()), soft_iron=tuple(soft.ravel().tolist()), **others)


def session(name: str, *, seconds: float = 14.0, fault: str = "", calibrated: bool = True, **motion) -> Session:
    clock = VirtualClock(5 * NS_PER_S)
    bought, moves = board(name), BesideAMagnet(axis_tilt_deg=10.0, **{"turn_deg": 180.0, **motion})
    aux = bought.aux_master(clock, moves, imperfections=TYPICAL_MAGNETOMETER)
    chip = FakeMpu6050(
        clock, motion=moves, imperfections=NOISE_ONLY, personality=bought.personality, aux=aux, pll_error=-0.006
    )
    bus = FakeBus({0x68: chip, **aux.outside()}, clock=clock)
    if fault:
        bus.adapter.faults.add(parse(fault))
    settings = Settings(
        chip=ChipConfig(gyro_range_dps=500, accel_range_g=4, dlpf=3, sample_rate_hz=100.0),
        loop=LoopSettings(rate_hz=50.0),
        magnetometer=MagnetometerParams(use="auto"),
        heading=calibration(bought.mounting) if calibrated else HeadingParams(),
    )
    return run_session(bus, clock, settings, seconds=seconds)


def heading_error_deg(ran: Session) -> np.ndarray:
    """Against magnetic north, (N,)."""
    error = to_euler(ran.attitude.q)[:, 2] - to_euler(ran.truth())[:, 2] - np.radians(DECLINATION_DEG)
    return np.degrees(np.angle(np.exp(1j * error)))


@pytest.mark.parametrize("name", [*BOARDS[:2], *(pytest.param(name, marks=pytest.mark.slow) for name in BOARDS[2:])])
def test_heading_of_a_board_on_a_turntable_is_wrong(name, caplog):
    caplog.set_level(logging.CRITICAL)
    ran = session(name)
    fixed = ran.attitude.yaw_from == YawFrom.MAGNETIC
    first = int(np.argmax(fixed))
    assert ran.world_s()[first] < 5.0
    assert fixed[first:].all()
    assert np.abs(heading_error_deg(ran)[first:]).max() < 1.0
    assert ran.imu.health.samples_lost == 0
    assert not (ran.attitude.flags & (Flag.FIELD_LOST | Flag.FIELD_DISTURBED)).any()
    assert message_of(ran.attitude[: first - 1], src="fake:x").yaw == "relative"
    assert message_of(ran.attitude, src="fake:x").yaw == "magnetic"


def test_magnet_beside_the_table_steers_the_heading():
    ran = session("gy-87-hmc5883l", laid_s=7.0, taken_s=12.0)
    t_s, error = ran.world_s(), np.abs(heading_error_deg(ran))
    fixed = ran.attitude.yaw_from == YawFrom.MAGNETIC
    assert error[fixed].max() < 1.0
    disturbed = ran.attitude.flags & Flag.FIELD_DISTURBED != 0
    assert disturbed[(t_s > 7.1) & (t_s < 12.0)].all()
    assert not disturbed[(t_s < 7.0) | (t_s > 13.0)].any()


def test_chip_that_lost_its_setting_takes_the_heading_with_it(caplog):
    caplog.set_level(logging.CRITICAL)
    ran = session("mpu-9250", fault="brown-out at=14.0", seconds=16.0, turn_deg=360.0)
    t_s = ran.world_s()
    assert ran.imu.health.chip_restarts == 1
    assert ran.imu.health.magnetometer_restarts == 1
    sigma = np.degrees(ran.attitude.sigma_rad[:, 2])
    error = np.abs(heading_error_deg(ran))
    assert (error < 3 * sigma)[ran.attitude.yaw_from == YawFrom.MAGNETIC].all()
    assert (ran.attitude.yaw_from[t_s > 6.0] == YawFrom.MAGNETIC).all()


def test_uncalibrated_magnetometer_steers_the_yaw_without_a_word(caplog):
    ran = session("gy-87", calibrated=False, seconds=6.0)
    assert (ran.attitude.yaw_from == YawFrom.RELATIVE).all()
    assert np.isfinite(ran.raw.field_ut).any()
    assert sum("not calibrated" in record.message for record in caplog.records) == 1
