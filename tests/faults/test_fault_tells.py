"""Every flag of a sample and every counter of `Health` has something that causes it; a new one must get its own."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import fields, replace

import pytest
from chip_rig import Rig, config
from magnetometer_rig import lying
from magnetometer_stream_rig import MagStreamRig

from hw_fakes import NOISE_ONLY, Tilt, Turntable
from hw_fakes.faults.plan import parse
from quavelet.calibration.model import ImuCalibration
from quavelet.core.blocks import Flag
from quavelet.core.health import Health
from quavelet.pipeline import build_pipeline
from quavelet.settings import Settings


@pytest.fixture(autouse=True)
def quiet():
    logging.disable(logging.WARNING)
    yield
    logging.disable(logging.NOTSET)


def struck(*faults: str, seconds: float = 1.5, warm_s: float = 3.0, **chip) -> Rig:
    rig = Rig(config(), **{"motion": Tilt(start_s=1e9), "imperfections": NOISE_ONLY, **chip}).start()
    rig.run(warm_s)
    for fault in faults:
        rig.fake_bus.adapter.faults.add(parse(fault))
    rig.run(seconds)
    return rig


def late() -> Rig:
    rig = struck(seconds=0.1)
    rig.drain(2000)
    rig.run(0.2)
    return rig


def nearly_full() -> Rig:
    rig = struck(seconds=0.1)
    rig.drain(1000 / 201 * 71.5)
    rig.run(0.2)
    return rig


def empty() -> Rig:
    """All registers stand as they should, and no sample comes."""
    rig = struck(seconds=0.1)
    rig.bus.alter = lambda _k, t, answer: bytes(len(answer)) if t.register in (0x72, 0x3A) else answer
    rig.run(0.15)
    return rig


def disturbed_start() -> Rig:
    rig = Rig(config(), motion=Tilt(), imperfections=NOISE_ONLY)
    rig.fake_bus.adapter.faults.add(parse("flip-write register=0x1b"))
    rig.start().run(0.5)
    return rig


def blown() -> Rig:
    """A board that lies on its side at +-2 g with more than that of bias."""
    big = NOISE_ONLY.__class__(
        accel_bias_m_s2=(60.0, 0.0, 0.0), accel_noise_m_s2_rthz=0.004, gyro_noise_rad_s_rthz=1e-4
    )
    return struck(imperfections=big)


def oscillator_out_of_bounds() -> Rig:
    return struck(pll_error=0.09)


def with_magnetometer(*, strength_ut: float = 49.0, unplugged: bool = False, seconds: float = 0.5) -> Rig:
    rig = MagStreamRig("gy-87-hmc5883l", motion=lying(strength_ut)).start()
    rig.run(0.5)
    back = rig.unplug() if unplugged else None
    rig.run(seconds)
    if back:
        back()
        rig.run(3.0)
    return rig


def pipelined(rig: Rig) -> int:
    pipeline = build_pipeline(Settings(), calibration=ImuCalibration(lowest_degc=15.0, highest_degc=35.0))
    flags = 0
    for block in rig.blocks:
        for row in pipeline.process(block).flags.tolist():
            flags |= row
    return flags


def spun() -> Rig:
    return struck(motion=Turntable(start_s=1.0, rate_deg_s=900.0, turn_deg=9000.0), seconds=1.0)


def slowly_turned() -> Rig:
    return struck(motion=Turntable(start_s=4.0, rate_deg_s=0.2, turn_deg=10.0), seconds=16.0)


FLAGS: dict[str, Callable[[], Rig]] = {
    "GAP": late,
    "OVERFLOW": late,
    "MISALIGNED": lambda: struck("slip bytes=3"),
    "BUS_ERROR": lambda: struck("eio p=0.3"),
    "GYRO_CLIPPED": spun,
    "ACCEL_CLIPPED": blown,
    "CLOCK_UNSURE": lambda: struck(seconds=0.1, warm_s=0.5),
    "BIAS_UNKNOWN": lambda: struck(seconds=0.1, warm_s=0.5),
    "SETTLING": lambda: struck("unplugged for=0.9"),
    "CHIP_UPSET": lambda: struck("brown-out"),
    "IMPLAUSIBLE": lambda: struck("temperature by=30 for=0.3"),
    "STUCK": lambda: struck("frozen for=1"),
    "HEADING_SUSPECT": slowly_turned,
    "UNCALIBRATED_TEMPERATURE": lambda: struck(
        imperfections=replace(NOISE_ONLY, temp_degc=50.0, warm_temp_degc=50.0), seconds=0.1
    ),
    "FIELD_LOST": lambda: with_magnetometer(unplugged=True, seconds=1.5),
    "FIELD_DISTURBED": lambda: with_magnetometer(strength_ut=400.0),
}
COUNTERS: dict[str, Callable[[], Rig]] = {
    "samples": lambda: struck(seconds=0.1),
    "samples_lost": late,
    "gaps": late,
    "drains": lambda: struck(seconds=0.1),
    "fifo_empty": lambda: struck("asleep"),
    "fifo_overflows": late,
    "fifo_near_full": nearly_full,
    "fifo_misaligned": lambda: struck("slip bytes=3"),
    "fifo_resets": late,
    "frames_implausible": lambda: struck("temperature by=30 for=0.3"),
    "spikes": lambda: struck("flip every=0.05 register=0x74 byte=8 bit=6 for=1"),
    "counts_surprising": lambda: struck("changed register=0x1a value=0"),
    "bus_errors": lambda: struck("nack"),
    "bus_retries": lambda: struck("nack"),
    "outages": lambda: struck("unplugged for=0.9"),
    "chip_restarts": lambda: struck("brown-out"),
    "config_mismatches": disturbed_start,
    "registers_upset": lambda: struck("changed register=0x1b value=0x18"),
    "starved": empty,
    "stuck": lambda: struck("frozen for=1"),
    "slow_queries": lambda: struck("slow factor=20 for=0.3"),
    "rate_out_of_bounds": oscillator_out_of_bounds,
    "data_ready_missed": lambda: struck("int-lost for=0.5", wired=True),
    "magnetometer_lost": lambda: with_magnetometer(unplugged=True, seconds=1.5),
    "magnetometer_restarts": lambda: with_magnetometer(unplugged=True, seconds=1.5),
}
ELSEWHERE = {"records_damaged": "tests/recording/test_recording_damage.py"}


@pytest.mark.parametrize("flag", list(Flag), ids=lambda flag: str(flag.name))
def test_flag_is_never_raised(flag):
    assert flag.name in FLAGS, f"{flag.name} has nothing here that causes it: add it"
    assert pipelined(FLAGS[flag.name]()) & flag


@pytest.mark.parametrize("counter", [field.name for field in fields(Health)])
def test_counter_never_counts(counter):
    if counter in ELSEWHERE:
        return
    assert counter in COUNTERS, f"Health.{counter} has nothing here that causes it: add it"
    assert getattr(COUNTERS[counter]().health, counter) > 0


@pytest.mark.parametrize("wired", [False, True])
def test_well_chip_raises_a_flag_or_a_counter(wired):
    rig = struck(warm_s=5.0, wired=wired)
    well = {"samples", "drains"}
    assert {name: n for name, n in rig.health.as_dict().items() if n and name not in well} == {}
    assert pipelined(rig) == Flag.CLOCK_UNSURE | Flag.BIAS_UNKNOWN | Flag.SETTLING
