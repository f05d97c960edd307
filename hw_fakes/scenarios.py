"""The worlds that `fake:NAME` opens."""

from __future__ import annotations

from dataclasses import replace

from hw_fakes.chip.counts import RecordedCounts
from hw_fakes.chip.mpu6050 import FakeMpu6050
from hw_fakes.wire.bench import BenchBus
from hw_fakes.wire.bus import FakeBus
from hw_fakes.world.imperfections import TYPICAL
from hw_fakes.world.motion import Motion, Still, Sway, Tilt, Turntable
from hw_fakes.world.motion_bench import Coning, SixFaces
from hw_fakes.world.motion_carried import Drone, Walk
from hw_fakes.world.motion_recorded import load_motion
from hw_fakes.world.motion_show import Show
from quavelet.core.clock import Clock
from quavelet.core.errors import SettingsError

MOTIONS: dict[str, Motion] = {
    "still": Still(),
    "tilt": Tilt(),
    "turntable": Turntable(),
    "sway": Sway(),
    "faces": SixFaces(),
    "coning": Coning(),
    "walk": Walk(),
    "drone": Drone(),
    "show": Show(),
}
CALIBRATED = replace(TYPICAL, gyro_scale=(1.0, 1.0, 1.0), accel_bias_m_s2=(0.0, 0.0, 0.0), accel_scale=(1.0, 1.0, 1.0))
"""Scale and zero of the accelerometer as they are left by a calibration; the gyroscope's bias is found at rest."""
SHOW = "show"
BENCH = "bench"
COUNTS = "counts:"
RECORDED = "motion:"
ADDRESS = 0x68
SEED = 6050


def open_fake(which: str, /, *, clock: Clock) -> FakeBus:
    """The bus `fake:WHICH`, with one MPU-6050 at 0x68: `targets[0x68]` is the chip, and its `motion` the truth.

    WHICH is what `motion_named` takes (a chip with TYPICAL imperfections, that of `show` a CALIBRATED one),
    `counts:FILE.npz` (recorded counts, see `RecordedCounts`), or `bench` or `bench:SEED` (a board that does what the
    bench session asks for, see `BenchBus`).
    Raises SettingsError for any other, or where the file cannot be used.
    """
    check_name(which)
    if which.startswith(BENCH):
        return BenchBus(clock=clock, seed=int(which.partition(":")[2] or 0), name=f"fake:{which}")
    if which.startswith(COUNTS):
        chip = counts_chip(RecordedCounts.load(which.removeprefix(COUNTS)), clock=clock)
    else:
        sensors = CALIBRATED if which == SHOW else TYPICAL
        chip = FakeMpu6050(clock, motion=motion_named(which), imperfections=sensors, seed=SEED)
    return FakeBus({ADDRESS: chip}, clock=clock, name=f"fake:{which}")


def motion_named(which: str) -> Motion:
    """A motion by its name in `MOTIONS`, or the recording of `motion:FILE.npz`, see `motion_recorded.load_motion`.

    Raises SettingsError for any other name, or where the file cannot be used.
    """
    if which.startswith(RECORDED):
        return load_motion(which.removeprefix(RECORDED))
    if which not in MOTIONS:
        raise SettingsError(f"there is no motion '{which}': take one of {', '.join(MOTIONS)}, {RECORDED}FILE.npz")
    return MOTIONS[which]


def check_name(which: str) -> None:
    """Raises SettingsError where `fake:WHICH` is the name of no world."""
    kind, _, seed = which.partition(":")
    if kind == BENCH and (which == BENCH or seed.isdecimal()):
        return
    if which not in MOTIONS and not which.startswith((RECORDED, COUNTS)):
        names = [f"fake:{name}" for name in (*MOTIONS, BENCH, f"{RECORDED}FILE.npz", f"{COUNTS}FILE.npz")]
        raise SettingsError(f"there is no 'fake:{which}': take one of {', '.join(names)}")


def counts_chip(recording: RecordedCounts, *, clock: Clock) -> FakeMpu6050:
    """A chip that plays `recording`; both its oscillators are off by what makes the nominal rate the recorded one."""
    error = recording.oscillator_error
    return FakeMpu6050(clock, source=recording, pll_error=error, internal_error=error)
