"""The worlds that `fake:NAME` opens."""

from __future__ import annotations

from hw_fakes.bus import FakeBus
from hw_fakes.chip import FakeMpu6050
from hw_fakes.counts import RecordedCounts
from hw_fakes.imperfections import TYPICAL
from hw_fakes.motion import Motion, Still, Sway, Tilt, Turntable
from hw_fakes.motion_bench import Coning, SixFaces
from hw_fakes.motion_carried import Drone, Walk
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
}
COUNTS = "counts:"
ADDRESS = 0x68


def open_fake(which: str, /, *, clock: Clock) -> FakeBus:
    """The bus `fake:WHICH`, with one MPU-6050 at 0x68: `targets[0x68]` is the chip, and its `motion` the truth.

    WHICH is a name of `MOTIONS` (a chip with TYPICAL imperfections) or `counts:FILE.npz` (recorded counts, see
    `RecordedCounts`). Raises SettingsError for any other, or where the file cannot be used.
    """
    if which.startswith(COUNTS):
        chip = counts_chip(RecordedCounts.load(which.removeprefix(COUNTS)), clock=clock)
    elif which in MOTIONS:
        chip = FakeMpu6050(clock, motion=MOTIONS[which], imperfections=TYPICAL, seed=6050)
    else:
        names = [f"fake:{name}" for name in (*MOTIONS, f"{COUNTS}FILE.npz")]
        raise SettingsError(f"there is no 'fake:{which}': take one of {', '.join(names)}")
    return FakeBus({ADDRESS: chip}, clock=clock, name=f"fake:{which}")


def counts_chip(recording: RecordedCounts, *, clock: Clock) -> FakeMpu6050:
    """A chip that plays `recording`; both its oscillators are off by what makes the nominal rate the recorded one."""
    error = recording.oscillator_error
    return FakeMpu6050(clock, source=recording, pll_error=error, internal_error=error)
