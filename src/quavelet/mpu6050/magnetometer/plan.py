"""What is asked of a magnetometer, and what has to be written and read for it: the same for both ways to its data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from quavelet.core.errors import SettingsError
from quavelet.mpu6050.registers import Register

Triple = tuple[float, float, float]
Matrix = tuple[Triple, Triple, Triple]

AS_THE_CHIP: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
IN_PACKAGE: Matrix = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
"""AKM's chip beside the gyroscope in one package: x and y exchanged, z down (orientation of axes in PS-MPU-9150A and
PS-MPU-9250A)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MagnetometerConfig:
    """How a magnetometer is to measure. Refuses with SettingsError what is no rotation.

    rate_hz   measurements a second; what a kind of chip can do stands in its `Kind`
    range_ut  full scale of an axis in uT, one of the chip's
    to_body   rotation of a vector in the magnetometer's axes into one in the MPU's; None: by what was found, in the
              package of an MPU-9150 or MPU-9250 as AKM's chip lies there, else as the MPU itself lies
    """

    rate_hz: float
    range_ut: float
    to_body: Matrix | None = None

    def __post_init__(self) -> None:
        if self.to_body is None:
            return
        m = np.array(self.to_body, dtype=float)
        if m.shape != (3, 3) or not np.allclose(m @ m.T, np.eye(3), atol=1e-6) or np.linalg.det(m) < 0:
            raise SettingsError(
                f"to_body = {self.to_body} is no rotation: give three rows at right angles, of length 1, right-handed"
            )


@dataclass(frozen=True, slots=True)
class Write:
    """A byte for a register, and how long the chip then wants to be left alone."""

    register: Register
    byte: int
    wait_ns: int = 0


@dataclass(frozen=True, slots=True)
class Run:
    """`n` registers to be read in one transaction, from `register` on."""

    register: Register
    n: int


@dataclass(frozen=True, slots=True)
class Words:
    """What the registers say.

    counts    x y z in the magnetometer's own axes
    ready     the chip calls them a measurement that nobody has read
    overflow  an axis is beyond what the chip can show; its count means nothing
    upset     the chip's settings are not those it was given
    """

    counts: tuple[int, int, int]
    ready: bool
    overflow: bool
    upset: bool = False


@dataclass(frozen=True, slots=True)
class Plan:
    """All that one kind of chip with one configuration needs.

    set_up        to be written in this order
    runs          to be read in this order for one sample; `decode` gets their bytes joined
    trigger       begins one measurement; None where the chip goes on by itself
    measuring_ns  what a triggered measurement takes at most
    ut_per_lsb    uT a count, by axis of the chip, the factory's adjustment in it
    adjustment    that adjustment, where this kind of chip has one
    """

    name: str
    address: int
    rate_hz: float
    set_up: tuple[Write, ...]
    runs: tuple[Run, ...]
    decode: Callable[[bytes], Words]
    ut_per_lsb: Triple
    trigger: Write | None = None
    measuring_ns: int = 0
    adjustment: tuple[int, int, int] | None = None

    @property
    def block_bytes(self) -> int:
        """Bytes of one sample."""
        return sum(run.n for run in self.runs)


def range_index(name: str, ranges_ut: tuple[float, ...], range_ut: float) -> int:
    """Which of the chip's ranges it is. Raises SettingsError."""
    if range_ut not in ranges_ut:
        known = ", ".join(f"{u:g}" for u in ranges_ut)
        raise SettingsError(f"range_ut = {range_ut:g} is not a range of the {name}: take one of {known}")
    return ranges_ut.index(range_ut)


def rate_index(name: str, rates_hz: tuple[float, ...], rate_hz: float) -> int:
    """Which of the chip's rates it is. Raises SettingsError."""
    if rate_hz not in rates_hz:
        known = ", ".join(f"{f:g}" for f in rates_hz)
        raise SettingsError(f"rate_hz = {rate_hz:g} is not a rate of the {name}: take one of {known}")
    return rates_hz.index(rate_hz)


def check_triggered_rate(name: str, rate_hz: float, *, fastest_hz: float) -> None:
    """Raises SettingsError where measurements cannot be begun so often."""
    if not 0 < rate_hz <= fastest_hz:
        raise SettingsError(f"rate_hz = {rate_hz:g} is not to be had from the {name}: take up to {fastest_hz:g}")
