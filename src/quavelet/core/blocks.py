"""Blocks: runs of consecutive samples with their times, the unit of flow.

Law: splitting a block anywhere never changes what a stage gives. Everything a stage needs to know
of a sample therefore stands in the sample's own row, and all else in the stage's state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from enum import IntEnum, IntFlag
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]
CountArray = NDArray[np.int16]
BoolArray = NDArray[np.bool_]
FlagArray = NDArray[np.uint32]
OriginArray = NDArray[np.uint8]


class Flag(IntFlag):
    """What is doubtful about a sample. A message shows the names in lower case."""

    GAP = 1
    """Samples were lost just before this one; `gap_ns` says how much time."""
    OVERFLOW = 2
    """The gap began with an overflow, or near overflow, of the chip's FIFO."""
    MISALIGNED = 4
    """The gap began with a FIFO that did not hold whole frames."""
    BUS_ERROR = 8
    """The gap began with a failed transfer."""
    GYRO_CLIPPED = 16
    """A gyroscope axis reads the end of its range."""
    ACCEL_CLIPPED = 32
    """An accelerometer axis reads the end of its range."""
    CLOCK_UNSURE = 64
    """The chip's sample period is not measured yet; the nominal one is used."""
    BIAS_UNKNOWN = 128
    """The gyroscope's bias is not measured yet: the board has not been still long enough."""
    SETTLING = 256
    """The attitude is not to be trusted yet (start while moving, or after a long gap)."""
    CHIP_UPSET = 512
    """The gap began with a chip that had lost its configuration or gave no samples, and was set up anew."""
    IMPLAUSIBLE = 1024
    """The gap began with frames that no sensor gives, which were thrown away."""
    STUCK = 2048
    """No axis has changed for so long that the chip is more likely stuck than still: real sensors have noise."""
    HEADING_SUSPECT = 4096
    """For ten seconds a small steady rate has been there that is not the bias: a slow turn, or a bias that has run
    away, which no six axes can tell apart. Until the board is still again heading may drift."""
    UNCALIBRATED_TEMPERATURE = 8192
    """The chip is warmer or colder than it was at any time of its calibration, which holds no longer."""
    FIELD_LOST = 16384
    """The magnetometer gives nothing, or not what it was told: heading is carried on by the gyroscope alone."""
    FIELD_DISTURBED = 32768
    """The magnetic field is not the Earth's here: heading is carried on by the gyroscope alone."""

    @classmethod
    def names(cls, value: int) -> list[str]:
        """Lower-case names of the bits set in `value`, lowest bit first."""
        return [str(flag.name).lower() for flag in cls if value & flag]


class YawFrom(IntEnum):
    """What yaw counts from. A message shows the name in lower case."""

    RELATIVE = 0
    """Wherever the board stood at the start; it drifts."""
    MAGNETIC = 1
    """Magnetic north along world y."""
    TRUE = 2
    """True north along world y."""


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """What every block carries; N rows, one a sample.

    t_ns       (N,) int64   when the sample was taken, CLOCK_MONOTONIC, strictly increasing
    period_s   (N,) float64 the chip's sample period as measured when the sample was read
    gap_ns     (N,) int64   time lost between the previous sample's end and this one, 0 if none
    flags      (N,) uint32  bits of `Flag`
    """

    t_ns: IntArray
    period_s: FloatArray
    gap_ns: IntArray
    flags: FlagArray

    def __post_init__(self) -> None:
        n = len(self.t_ns)
        for name in array_fields(type(self)):
            array = getattr(self, name)
            if len(array) != n:
                raise ValueError(f"{type(self).__name__}.{name} has {len(array)} rows where t_ns has {n}")

    def __len__(self) -> int:
        return len(self.t_ns)

    def __getitem__(self, rows: slice | list[int]) -> Self:
        """The block of these rows: views of a slice, copies of numbered rows."""
        arrays = array_fields(type(self))
        return type(self)(
            **{f.name: getattr(self, f.name)[rows] if f.name in arrays else getattr(self, f.name)
               for f in fields(self)}
        )  # fmt: skip


_NO_FIELD = np.full((1, 3), np.nan)
_RELATIVE = np.zeros(1, dtype=np.uint8)


def _no_rows() -> NDArray[Any]:
    return _NONE


_NONE = np.zeros(0)


def _fill(block: Block, name: str, row: NDArray[Any]) -> None:
    """Where the block was made without this array, the same `row` for each sample, which takes no memory."""
    if getattr(block, name) is _NONE:
        object.__setattr__(block, name, np.broadcast_to(row[0], (len(block), *row.shape[1:])))


@dataclass(frozen=True, slots=True)
class Scale:
    """What one count means, from the range registers as read back from the chip."""

    gyro_rad_s_per_lsb: float
    accel_m_s2_per_lsb: float
    temp_degc_per_lsb: float
    temp_degc_at_zero: float


@dataclass(frozen=True, slots=True, eq=False)
class RawBlock(Block):
    """Counts as the chip gave them.

    counts    (N, 7) int16  accelerometer x y z, temperature, gyroscope x y z (the order of the registers)
    scale     what one count means
    field_ut  (N, 3) float64  magnetic field in the body frame, not calibrated, uT; NaN in rows without a new
              measurement. A block made without it has none.
    """

    counts: CountArray
    scale: Scale
    field_ut: FloatArray = field(default_factory=_no_rows)

    def __post_init__(self) -> None:
        _fill(self, "field_ut", _NO_FIELD)
        Block.__post_init__(self)


@dataclass(frozen=True, slots=True, eq=False)
class ImuBlock(Block):
    """Calibrated samples in SI, body frame.

    gyro_rad_s       (N, 3) angular rate, bias removed
    accel_m_s2       (N, 3) specific force, +g up at rest
    temp_degc        (N,)   die temperature
    gyro_bias_rad_s  (N, 3) the bias that was removed from the rate, beyond that of the calibration
    still            (N,)   the board stood still up to this sample
    field_ut         (N, 3) magnetic field as in RawBlock
    """

    gyro_rad_s: FloatArray
    accel_m_s2: FloatArray
    temp_degc: FloatArray
    gyro_bias_rad_s: FloatArray
    still: BoolArray
    field_ut: FloatArray = field(default_factory=_no_rows)

    def __post_init__(self) -> None:
        _fill(self, "field_ut", _NO_FIELD)
        Block.__post_init__(self)


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeBlock(Block):
    """Attitude of the board, body to world, ENU with arbitrary azimuth while heading is unknown.

    q                (N, 4) unit quaternion, Hamilton, scalar first, q[0] >= 0
    sigma_rad        (N, 3) one sigma of the small rotation about world x, y (tilt) and z (yaw)
    gyro_rad_s, accel_m_s2, temp_degc, still  as in ImuBlock, of the same instant
    gyro_bias_rad_s  (N, 3) all that was taken off the rate: measured at rest, and the filter's integral
    delay_ns         how much older than the newest sample read the attitude is
    yaw_from         (N,) uint8  what yaw counts from, a `YawFrom`; a block made without it is relative
    """

    q: FloatArray
    sigma_rad: FloatArray
    gyro_rad_s: FloatArray
    accel_m_s2: FloatArray
    temp_degc: FloatArray
    gyro_bias_rad_s: FloatArray
    still: BoolArray
    delay_ns: int = 0
    yaw_from: OriginArray = field(default_factory=_no_rows)

    def __post_init__(self) -> None:
        _fill(self, "yaw_from", _RELATIVE)
        Block.__post_init__(self)


_ARRAY_FIELDS: dict[type[Block], tuple[str, ...]] = {}


def array_fields(kind: type[Block]) -> tuple[str, ...]:
    """Names of the fields of `kind` that have one row a sample."""
    names = _ARRAY_FIELDS.get(kind)
    if names is None:
        names = tuple(f.name for f in fields(kind) if f.name not in ("scale", "delay_ns"))
        _ARRAY_FIELDS[kind] = names
    return names


B = TypeVar("B", bound=Block)


def concat(blocks: Sequence[B]) -> B:
    """One block of all rows of `blocks` (at least one), in their order.

    Raises ValueError where there is none, or where they differ in scale or delay.
    """
    if not blocks:
        raise ValueError("nothing to join: give at least one block")
    first = blocks[0]
    arrays = array_fields(type(first))
    values = {}
    for f in fields(first):
        if f.name in arrays:
            values[f.name] = np.concatenate([getattr(b, f.name) for b in blocks])
        else:
            values[f.name] = getattr(first, f.name)
            if any(getattr(b, f.name) != values[f.name] for b in blocks):
                raise ValueError(f"blocks of different {f.name} cannot be joined: join each run by itself")
    return type(first)(**values)
