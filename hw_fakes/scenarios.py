"""The worlds that `fake:NAME` opens."""

from __future__ import annotations

from hw_fakes.bus import FakeBus
from hw_fakes.chip import FakeMpu6050
from hw_fakes.imperfections import TYPICAL
from hw_fakes.motion import Motion, Still, Sway, Tilt, Turntable
from quavelet.core.clock import Clock
from quavelet.core.errors import SettingsError

MOTIONS: dict[str, Motion] = {"still": Still(), "tilt": Tilt(), "turntable": Turntable(), "sway": Sway()}
ADDRESS = 0x68


def open_fake(which: str, /, *, clock: Clock) -> FakeBus:
    """The bus `fake:WHICH`, with a typical MPU-6050 at 0x68: `targets[0x68]` is the chip, and its `motion` the truth.

    WHICH is a name of `MOTIONS`. Raises SettingsError for any other.
    """
    motion = MOTIONS.get(which)
    if motion is None:
        raise SettingsError(f"there is no fake:{which}: take one of {', '.join(f'fake:{name}' for name in MOTIONS)}")
    chip = FakeMpu6050(clock, motion=motion, imperfections=TYPICAL, pll_error=0.007, internal_error=-0.03, seed=6050)
    return FakeBus({ADDRESS: chip}, clock=clock, name=f"fake:{which}")
