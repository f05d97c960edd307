"""What a picture shows: curves, bars or points, with their labels. Data alone; `plot.py` draws it."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Literal

from quavelet.core.blocks import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """One curve, one set of bars or one cloud of points; `x` and `y` of one length, NaN is a gap."""

    label: str
    """"" keeps it out of the legend."""
    x: FloatArray
    y: FloatArray
    _: KW_ONLY
    dashed: bool = False
    """A limit, a truth: drawn thin and dashed, in grey."""
    dotted: bool = False
    """What was fitted to another curve: drawn thin and dotted over it, in the colour of the letters."""
    band: tuple[FloatArray, FloatArray] | None = None
    """Lines: between which `y` may as well be, drawn as a shade."""

    @property
    def coloured(self) -> bool:
        """Has it a colour of its own?"""
        return not (self.dashed or self.dotted)


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """One picture. Several curves of one label family share a colour order, so keep methods in one order."""

    name: str
    """The file's stem, unique in the whole study: "000-still-heading"."""
    title: str
    x_label: str
    """With the unit: "time, s"."""
    y_label: str
    curves: tuple[Curve, ...]
    _: KW_ONLY
    kind: Literal["line", "bars", "points"] = "line"
    """Bars: each curve is one colour, `x` the number of the group, from 0."""
    ticks: tuple[str, ...] = ()
    """Bars: the names of the groups."""
    equal: bool = False
    """One unit is as long upwards as it is sideways: a circle is round."""
    log_x: bool = False
    log_y: bool = False
    note: str = ""
    """One sentence under the picture: what is to be seen in it."""
