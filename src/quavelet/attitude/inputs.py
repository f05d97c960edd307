"""What a filter takes of a block, row by row."""

from __future__ import annotations

import numpy as np

from quavelet.core.blocks import ImuBlock

COLUMNS = ("gyro_rad_s", "accel_m_s2", "period_s", "temp_degc", "gyro_bias_rad_s")


def refuse_bad(block: ImuBlock) -> None:
    """Raise ValueError naming the first value that is no number, or the first period that is none.

    A filter remembers, so that one NaN would be the last attitude it ever gave.
    """
    for name in COLUMNS:
        values = getattr(block, name)
        if not np.isfinite(values).all():
            row = int(np.argwhere(~np.isfinite(values))[0][0])
            raise ValueError(f"{name} of row {row} is not a number: leave the row out and flag the next one as a GAP")
    if not (block.period_s > 0.0).all():
        raise ValueError("period_s has a row that is not above zero: give the sample period in s")
