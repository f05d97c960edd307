"""The noise of sensors that lay still: a table, and the Allan deviation with what was fitted to it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from quavelet.calibration.allan import FIT_FROM_S, DataSheet, Term
from quavelet.calibration.noise import AxisNoise
from quavelet.drawing.chart import Chart, Curve
from quavelet.drawing.page import Cell, Mark, Table, significant

BRACKETS = "A noise figure in brackets is not seen in so short a record, the number is the most it can be (95 %)."
_HEAD = (
    "sensor", "unit", "mean", "density, /rtHz", "data sheet", "judged", "bias instability", "random walk, /rts",
    "drift, /h", "least deviation", "averaged over",
)  # fmt: skip
_MARKS: dict[str, Mark] = {"good": "good", "poor": "bad"}


def noise_table(noise: Sequence[AxisNoise]) -> Table:
    """A row an axis, in the data sheet's units."""
    rows = []
    for one in noise:
        sheet = one.sheet
        unit = 1.0 / sheet.unit_si
        least, tau_s = one.curve.minimum()
        word = sheet.word(one.fit.density.value) if one.fit else ""
        terms = ["", "", "", ""]
        if one.fit:
            shown = ((one.fit.density, unit), (one.fit.instability, unit), (one.fit.walk, unit))
            terms = [*(_term(term, factor) for term, factor in shown), _term(one.fit.ramp, 3600.0 * unit)]
        rows.append(
            (
                Cell(f"{sheet.name} {one.axis}"),
                Cell(sheet.unit),
                Cell(significant(one.mean * unit, 4)),
                Cell(terms[0]),
                Cell(f"{sheet.density:g}"),
                Cell(word, _MARKS.get(word, "")),
                *(Cell(term) for term in terms[1:]),
                Cell(significant(least * unit, 3)),
                Cell(f"{significant(tau_s, 2)} s"),
            )
        )
    return Table("Noise at rest", _HEAD, tuple(rows), numbers=frozenset({2, 3, 4, 6, 7, 8, 9, 10}), cards=True)


def allan_charts(noise: Sequence[AxisNoise], name: str) -> tuple[Chart, ...]:
    """A chart a sensor; `name` keeps the charts' file names apart."""
    sheets = dict.fromkeys(one.sheet for one in noise)
    return tuple(_allan_chart(sheet, [one for one in noise if one.sheet is sheet], name) for sheet in sheets)


def _allan_chart(sheet: DataSheet, axes: Sequence[AxisNoise], name: str) -> Chart:
    curves = []
    for one in axes:
        low, high = one.curve.bounds()
        unit = sheet.unit_si
        curves.append(Curve(one.axis, one.curve.tau_s, one.curve.deviation / unit, band=(low / unit, high / unit)))
    tau_s = axes[0].curve.tau_s
    fitted = [(one.fit, one.curve.tau_s[one.curve.tau_s >= FIT_FROM_S]) for one in axes if one.fit is not None]
    for k, (fit, over_s) in enumerate(fitted):
        curves.append(Curve("" if k else "fitted", over_s, fit.deviation(over_s) / sheet.unit_si, dotted=True))
    curves.append(Curve("data sheet", tau_s, sheet.density / np.sqrt(2.0 * tau_s), dashed=True))
    return Chart(
        f"{name}-allan-{sheet.name}",
        f"Allan deviation of the {sheet.name} at rest",
        "averaging time, s",
        f"deviation, {sheet.unit}",
        tuple(curves),
        log_x=True,
        log_y=True,
        note="How far two means over this time, one after the other, are apart; the shade is what it may as well be "
        "(95 %). White noise falls by the square root of the time, a bias that "
        "moves rises.",
    )


def _term(term: Term, factor: float) -> str:
    if not term.seen:
        return f"(< {significant(term.limit * factor, 2)})"
    return f"{significant(term.value * factor, 3)} ± {significant(term.sigma * factor, 1)}"
