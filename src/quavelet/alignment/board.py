"""The first attitude of a board from its samples as they come: wait for stillness, then what its sensors can give."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from quavelet.alignment.earth_rate import gyrocompass
from quavelet.alignment.result import Alignment, Heading
from quavelet.alignment.sensors import SensorErrors
from quavelet.alignment.two_vectors import align_field, align_level
from quavelet.core.blocks import Flag, FloatArray, ImuBlock, concat

SPOILT = Flag.GAP | Flag.STUCK | Flag.ACCEL_CLIPPED | Flag.GYRO_CLIPPED
"""A sample with one of these ends a stretch of stillness."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stillness:
    """What became of the search for a stretch of stillness.

    block     the longest one, None where no sample was still
    still_s   how long it is
    all_s     how long the samples are together
    stuck     whether samples were flagged STUCK, which looks stiller than any board is
    """

    block: ImuBlock | None
    still_s: float
    all_s: float
    stuck: bool


def longest_still(blocks: Iterable[ImuBlock], *, enough_s: float = 60.0) -> Stillness:
    """The longest unbroken run of samples that the stage `StillBias` has called still, at most about `enough_s`.

    It looks no further once it has that much: the mean of a minute is better than the accelerometer's zero is known.
    """
    best, run = list[ImuBlock](), list[ImuBlock]()
    best_s = run_s = all_s = 0.0
    stuck = False
    for block in blocks:
        good = block.still & ((block.flags & np.uint32(SPOILT)) == 0)
        stuck |= bool((block.flags & np.uint32(Flag.STUCK)).any())
        all_s += float(block.period_s.sum())
        edges = np.flatnonzero(np.diff(good)) + 1
        for start, end in zip([0, *edges.tolist()], [*edges.tolist(), len(block)], strict=True):
            if start == end:
                continue
            if not good[start]:
                run, run_s = [], 0.0
                continue
            run.append(block[start:end])
            run_s += float(block.period_s[start:end].sum())
            if run_s > best_s:
                best, best_s = list(run), run_s
        if best_s >= enough_s:
            break
    return Stillness(block=concat(best) if best else None, still_s=best_s, all_s=all_s, stuck=stuck)


def align_board(
    still: ImuBlock,
    *,
    errors: SensorErrors,
    latitude_rad: float | None = None,
    field_ut: FloatArray | None = None,
    declination_rad: float = 0.0,
) -> Alignment:
    """The attitude of a board at rest: heading by its magnetometer, else refused with the figures of its gyroscope.

    latitude_rad   of the place, for those figures; None: the equator's, which are the best there are
    field_ut       (M, 3) what a calibrated magnetometer beside it measured meanwhile, body frame; rows with a NaN have
                   no measurement

    Raises ValueError where the samples are not finite or not gravity.
    """
    period_s = float(still.period_s.mean())
    if field_ut is not None:
        measured = field_ut[~np.isnan(field_ut).any(axis=1)]
        if len(measured):
            return align_field(
                still.accel_m_s2, measured, period_s=period_s, errors=errors, declination_rad=declination_rad
            )
    level = align_level(still.accel_m_s2, period_s=period_s, errors=errors)
    verdict, heading_rad, figures = gyrocompass(errors, latitude_rad=latitude_rad or 0.0)
    if verdict is Heading.OBSERVED:
        # The rates have lost the earth's with the bias, which was taken at this very rest.
        return level
    place = "" if latitude_rad is not None else "even at the equator "
    return replace(
        level,
        heading=verdict,
        reason=f"no calibrated magnetometer, and {place}{figures}",
        heading_sigma_rad=heading_rad,
    )
