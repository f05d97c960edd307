"""What every magnetometer chip is made of: a register pointer, measurements at their own instants, and its errors."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from hw_fakes.world.imperfections import FloatArray, Matrix, Triple
from hw_fakes.world.motion_base import Motion
from quavelet.core.clock import Clock
from quavelet.core.units import NS_PER_S

UT_PER_GAUSS = 100.0
NO_ROTATION: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class MagnetometerImperfections:
    """Errors of a magnetometer, in its own axes: what it shows is soft iron * truth + hard iron + noise.

    soft_iron   row i is what axis i shows; scale and misalignment are in it too
    noise_ut    white, sd of a measurement that is not averaged
    rate_error  how much too fast its oscillator is: 0.01 is 1 % more measurements a second
    seed        of the noise, which is a function of it and of the measurement's number
    """

    hard_iron_ut: Triple = (0.0, 0.0, 0.0)
    soft_iron: Matrix = NO_ROTATION
    noise_ut: float = 0.0
    rate_error: float = 0.0
    seed: int = 0


PERFECT_MAGNETOMETER = MagnetometerImperfections()
"""No error but the resolution of the words."""

TYPICAL_MAGNETOMETER = MagnetometerImperfections(
    hard_iron_ut=(14.0, -22.0, 9.0),
    soft_iron=((1.04, 0.02, -0.01), (0.02, 0.97, 0.015), (-0.01, 0.015, 1.01)),
    noise_ut=0.3,
    rate_error=0.01,
)
"""One on a board with pins and screws near by: plausible, but of no part in particular."""


@dataclass(frozen=True, slots=True)
class Series:
    """Measurements that follow one command: the first ends `first_ns` after the start, the others each `period_ns`.

    A period of 0 stands for one measurement only.
    """

    start_ns: int
    first_ns: int
    period_ns: int

    def ended_by(self, now_ns: int) -> int:
        """How many have ended by `now_ns`."""
        since_ns = now_ns - self.start_ns - self.first_ns
        if since_ns < 0:
            return 0
        return since_ns // self.period_ns + 1 if self.period_ns else 1

    def end_ns(self, index: int) -> int:
        """When measurement 0, 1, ... ends."""
        return self.start_ns + self.first_ns + index * self.period_ns


@dataclass(frozen=True, slots=True)
class Measurement:
    """One measurement: its number since the chip was made, its end, and the settings it was made with."""

    number: int
    t_ns: int
    settings: tuple[int, ...]


class Magnetometer(ABC):
    """A magnetometer that behaves, at the level of I2C messages; a `Target`.

    The field is that of the moment a measurement ends. It is computed only when someone reads it, and is the same
    however often and by whatever way the chip is looked at.

    address       where it sits on the bus
    measurements  how many have ended since it was made, as of the last transaction
    """

    address: ClassVar[int]
    _series: Series | None
    _ended: int  # of the series
    _shown: Measurement | None
    _words: tuple[int, int, int] | None
    _felt: tuple[Measurement, FloatArray, FloatArray] | None

    def __init__(
        self,
        clock: Clock,
        motion: Motion,
        *,
        imperfections: MagnetometerImperfections = PERFECT_MAGNETOMETER,
        mounting: Matrix = NO_ROTATION,
        birth_ns: int | None = None,
    ) -> None:
        """A chip that is just powered up.

        mounting  turns a vector in body axes into one in the sensor's axes
        birth_ns  clock time at which the motion's time is zero; None: now
        """
        self.clock = clock
        self.motion = motion
        self.imperfections = imperfections
        self.mounting = np.array(mounting)
        self.birth_ns = clock.now_ns() if birth_ns is None else birth_ns
        self.measurements = 0
        self._soft_iron = np.array(imperfections.soft_iron)
        self._now_ns = clock.now_ns()
        self._in_transaction = False
        self.power_cut()

    # Messages

    def write(self, data: bytes) -> None:
        """The register pointer, then bytes for that register and those after it. Raises `Nack` where it is silent."""
        self._begin()
        if not data:
            return
        self._pointer = data[0]
        for value in data[1:]:
            self._store(self._pointer, value)
            self._pointer = self._after(self._pointer)

    def read(self, n: int) -> bytes:
        """`n` bytes from the register pointer on. Raises `Nack` where it is silent."""
        self._begin()
        answer = bytearray()
        for _ in range(n):
            answer.append(self._load(self._pointer))
            self._pointer = self._after(self._pointer)
        return bytes(answer)

    def stop(self) -> None:
        """The end of a transaction: from here on the registers show newer measurements."""
        self._in_transaction = False

    def power_cut(self) -> None:
        """The supply fails and comes back: power-up values."""
        self._now_ns = self.clock.now_ns()
        self._pointer = 0
        self._reset()

    # The field

    def field_ut(self, t_ns: int) -> FloatArray:
        """What it would show (3,) of the field at clock time `t_ns`, in its own axes, without noise and resolution."""
        t_s = np.array([(t_ns - self.birth_ns) / NS_PER_S])
        truth = self.mounting @ self.motion.magnetic_field_ut(t_s)[0]
        shown: FloatArray = self._soft_iron @ truth + np.array(self.imperfections.hard_iron_ut)
        return shown

    def noise_ut(self, number: int) -> FloatArray:
        """The noise (3,) of measurement `number`, not averaged."""
        if not self.imperfections.noise_ut:
            return np.zeros(3)
        rng = np.random.default_rng((self.imperfections.seed, number))
        noise: FloatArray = self.imperfections.noise_ut * rng.standard_normal(3)
        return noise

    # For the chips

    def _begin(self) -> None:
        if not self._in_transaction:
            self._in_transaction = True
            self._follow()

    def _follow(self) -> None:
        """Take the measurements that ended since the last look."""
        self._now_ns = self.clock.now_ns()
        series = self._series
        if series is None:
            return
        ended = series.ended_by(self._now_ns)
        before = ended - self._ended - 1  # of those, how many came before the newest
        if before < 0:
            return
        self._ended = ended
        self.measurements += before + 1
        newest = Measurement(self.measurements - 1, series.end_ns(ended - 1), self._settings(self.measurements - 1))
        if not series.period_ns:
            self._series = None
        self._placed(newest, before)

    def _reset(self) -> None:
        """Power-up values, and no data."""
        self._series = self._shown = self._words = self._felt = None
        self._ended = 0
        self._power_up()

    def _measure(self, *, first_ns: int, rate_hz: float = 0.0) -> None:
        """Begin a series now; without a rate it is one measurement."""
        faster = 1 + self.imperfections.rate_error
        period_ns = round(NS_PER_S / (rate_hz * faster)) if rate_hz else 0
        self._series, self._ended = Series(self._now_ns, round(first_ns / faster), period_ns), 0

    def _rest(self) -> None:
        """End the series; a measurement that is under way is lost."""
        self._series = None

    def _show(self, measurement: Measurement) -> None:
        self._shown, self._words = measurement, None

    def _field_and_noise_ut(self, measurement: Measurement) -> tuple[FloatArray, FloatArray]:
        """What a measurement felt (3,), and its noise (3,); that of the last one asked for is kept."""
        if self._felt is None or self._felt[0] is not measurement:
            self._felt = measurement, self.field_ut(measurement.t_ns), self.noise_ut(measurement.number)
        return self._felt[1:]

    def _data(self) -> tuple[int, int, int]:
        """The x y z words of the measurement shown; zeros before the first."""
        if self._words is None:
            self._words = self._counts(self._shown) if self._shown else (0, 0, 0)
        return self._words

    @abstractmethod
    def _power_up(self) -> None:
        """Bring the registers to their power-up values."""

    @abstractmethod
    def _settings(self, number: int, /) -> tuple[int, ...]:
        """The settings of measurement `number`, which ends now."""

    @abstractmethod
    def _placed(self, newest: Measurement, before: int, /) -> None:
        """`before` measurements and then the newest ended since the last look."""

    @abstractmethod
    def _counts(self, measurement: Measurement) -> tuple[int, int, int]:
        """The x y z words of a measurement."""

    @abstractmethod
    def _load(self, register: int) -> int:
        """Read a register, with what the reading does."""

    @abstractmethod
    def _store(self, register: int, value: int) -> None:
        """Write a register, with what the writing does."""

    @abstractmethod
    def _after(self, register: int) -> int:
        """Where the pointer goes after a byte of `register`."""


def triple(values: FloatArray) -> tuple[int, int, int]:
    """Three numbers (3,) as whole ones."""
    x, y, z = (int(value) for value in np.rint(values))
    return x, y, z
