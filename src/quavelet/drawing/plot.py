"""Charts as SVG and PNG: the only file that imports matplotlib.

An SVG takes its ink from where it stands (`currentColor`) and has no ground, so one picture is read on a light page
and a dark one; as a file of its own it carries both grounds. A PNG is on light ground.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from textwrap import wrap

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

from quavelet.core.blocks import FloatArray
from quavelet.drawing.chart import Chart, Curve

# Of one lightness, in between: each stands out from white and from near black by more than 3 to 1.
COLOURS = ("#3b82d0", "#d9701a", "#2c9e5b", "#a066d3", "#d64550", "#1f98a8", "#a0764a", "#c2559b", "#8f8f1a", "#5f66d8")
GREY = "#868e96"
_INK = "#212529"
"""Stands for the page's ink; no curve has it."""
_WIDTH_IN, _HEIGHT_IN, _LINE_IN = 5.6, 3.1, 0.2
"""Small, so that its letters are still letters on a telephone; a line of title or legend makes it higher."""
_EQUAL_HEIGHT_IN = 4.9
_BUCKETS = 700
"""A longer line is drawn by the least and the greatest value of so many stretches."""
_LEGEND_WIDTH, _KEY_LETTERS = 74, 7
"""Letters of one line of the legend, and of the sample of the line before each label."""
_TITLE_WIDTH = 58
_Y_LABEL_WIDTH = 32
_ROOMY_TICKS = 4
_OWN_GROUND = """<style>
svg{color:#212529;background:#fff}
@media(prefers-color-scheme:dark){svg{color:#dee2e6;background:#16181d}}
</style>"""


def colours_of(charts: Iterable[Chart]) -> dict[str, str]:
    """A colour for each label: the same label has the same in all of the charts. Charts that share a label are of one
    family, whose labels have different colours as far as there are any; each family begins with the first."""
    colours: dict[str, str] = {}
    family_of: dict[str, int] = {}
    used: list[int] = []
    for chart in charts:
        labels = [curve.label for curve in chart.curves if curve.coloured]
        family = next((family_of[label] for label in labels if label in family_of), len(used))
        if family == len(used):
            used.append(0)
        for label in labels:
            if label not in colours:
                colours[label] = COLOURS[used[family] % len(COLOURS)]
                family_of[label] = family
                used[family] += 1
    return colours


def svg(chart: Chart, colours: Mapping[str, str]) -> str:
    """The chart as an SVG element to stand in a page: the same text for the same chart."""
    with _styled(chart):
        file = io.StringIO()
        _drawn(chart, colours).savefig(
            file, format="svg", transparent=True, metadata={"Date": None, "Creator": None, "Title": chart.title}
        )
    text = file.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    # Half of a line's text are digits that no screen shows.
    text = re.sub(r' (d|x|y)="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), text)
    return text.replace(_INK, "currentColor").strip()


def svg_file(element: str) -> str:
    """An SVG element as a file of its own, on a ground that goes with the reader's."""
    end = element.index(">") + 1
    return f'<?xml version="1.0" encoding="utf-8"?>\n{element[:end]}\n{_OWN_GROUND}{element[end:]}\n'


def png(chart: Chart, colours: Mapping[str, str]) -> bytes:
    """The chart as a PNG on white, twice as fine as a screen's 96 dots an inch."""
    with _styled(chart):
        file = io.BytesIO()
        _drawn(chart, colours).savefig(file, format="png", dpi=192, facecolor="white", metadata={"Software": None})
    return file.getvalue()


@contextmanager
def _styled(chart: Chart) -> Iterator[None]:
    # The salt makes the names within the SVG the same each time, and different from those of other charts.
    with matplotlib.rc_context(
        {
            "svg.hashsalt": chart.name,
            "font.size": 10.5,
            "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial", "sans-serif"],
            "axes.edgecolor": GREY,
            "axes.labelcolor": _INK,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.grid": True,
            "axes.axisbelow": True,
            "axes.unicode_minus": False,
            "grid.color": GREY,
            "grid.alpha": 0.3,
            "grid.linewidth": 0.6,
            "lines.linewidth": 1.4,
            "text.color": _INK,
            "xtick.color": GREY,
            "ytick.color": GREY,
            "xtick.labelcolor": _INK,
            "ytick.labelcolor": _INK,
            "legend.frameon": False,
            "legend.fontsize": 9.5,
            "svg.fonttype": "none",
            "path.simplify": True,
        }
    ):
        yield


def _drawn(chart: Chart, colours: Mapping[str, str]) -> Figure:
    labels = [curve.label for curve in chart.curves if curve.label]
    columns = _legend_columns(labels)
    title = wrap(chart.title, _TITLE_WIDTH)
    lines = len(title) + (-(-len(labels) // columns) if labels else 0)
    height_in = (_EQUAL_HEIGHT_IN if chart.equal else _HEIGHT_IN) + lines * _LINE_IN
    figure = Figure(figsize=(_WIDTH_IN, height_in), layout="constrained")
    axes = figure.add_subplot()
    figure.suptitle("\n".join(title), x=0.01, ha="left", fontsize=11, fontweight="bold")
    axes.set_xlabel(chart.x_label)
    axes.set_ylabel("\n".join(wrap(chart.y_label, _Y_LABEL_WIDTH)))
    if chart.kind == "bars":
        _bars(axes, chart, colours)
    else:
        calmest_last = sorted(chart.curves, key=_unrest, reverse=True)
        for curve in chart.curves:
            drawn = _curve(axes, curve, colours, points=chart.kind == "points", log_x=chart.log_x)
            # A noisy curve would hide a calm one that lay below it.
            drawn.set_zorder((4.0 if curve.dotted else 2.0) + calmest_last.index(curve) / 100.0)
        axes.margins(x=0.02)
        if chart.kind == "points" and all((curve.x == np.round(curve.x)).all() for curve in chart.curves):
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    if chart.equal:
        axes.set_aspect("equal", adjustable="datalim")
    if chart.log_x:
        axes.set_xscale("log")
        _plain_numbers(axes.xaxis, [curve.x for curve in chart.curves])
    if chart.log_y:
        axes.set_yscale("log")
        _plain_numbers(axes.yaxis, [curve.y for curve in chart.curves])
    if labels:
        axes.legend(
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            borderaxespad=0.2,
            borderpad=0.1,
            ncols=columns,
            columnspacing=1.2,
            handlelength=1.4,
        )
    return figure


def _legend_columns(labels: Sequence[str]) -> int:
    """As many columns as fit: matplotlib fills one after the other, each as wide as its longest label."""
    for columns in range(len(labels), 1, -1):
        rows, longer = divmod(len(labels), columns)
        ends = [(k + 1) * rows + min(k + 1, longer) for k in range(columns)]
        groups = [labels[start:end] for start, end in pairwise([0, *ends])]
        if sum(max(map(len, group)) + _KEY_LETTERS for group in groups) <= _LEGEND_WIDTH:
            return columns
    return 1


def _curve(axes: Axes, curve: Curve, colours: Mapping[str, str], *, points: bool, log_x: bool) -> Line2D:
    colour = colours[curve.label] if curve.coloured else _INK if curve.dotted else GREY
    label = curve.label or None
    if points and curve.coloured:
        (line,) = axes.plot(curve.x, curve.y, linestyle="none", marker="o", markersize=3.5, color=colour, label=label)
        return line
    x, y = (curve.x, curve.y) if log_x else _thinned(curve.x, curve.y)
    width = 1.6 if curve.coloured and len(x) <= _BUCKETS else 1.1
    style = "--" if curve.dashed else ":" if curve.dotted else "-"
    (line,) = axes.plot(x, y, linestyle=style, linewidth=width, color=colour, label=label)
    if curve.band is not None:
        axes.fill_between(curve.x, *curve.band, color=colour, alpha=0.2, linewidth=0.0)
    return line


def _unrest(curve: Curve) -> float:
    return float(np.nansum(np.abs(np.diff(curve.y))))


def _plain_numbers(axis: Axis, values: Sequence[FloatArray]) -> None:
    """Ticks of a logarithmic axis as 0.1, 1, 10; where there are few decades also twice and five times those."""
    positive = np.concatenate(values)
    positive = positive[np.isfinite(positive) & (positive > 0.0)]
    decades = float(np.log10(positive.max() / positive.min())) if len(positive) else 0.0
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 2.0 else (1.0,)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _bars(axes: Axes, chart: Chart, colours: Mapping[str, str]) -> None:
    bars = [curve for curve in chart.curves if curve.coloured]
    width = 0.8 / max(1, len(bars))
    for k, curve in enumerate(bars):
        place = curve.x + (k - (len(bars) - 1) / 2) * width
        axes.bar(place, curve.y, width=0.92 * width, color=colours[curve.label], label=curve.label or None)
    for curve in chart.curves:
        if curve.dashed:
            axes.plot(curve.x, curve.y, "--", linewidth=1.1, color=GREY, label=curve.label or None)
    axes.grid(visible=False, axis="x")
    if chart.ticks:
        room = _LEGEND_WIDTH // len(chart.ticks) - 1
        slanted = max(len(word) for tick in chart.ticks for word in tick.split()) > room
        texts = list(chart.ticks) if slanted else ["\n".join(wrap(tick, room)) for tick in chart.ticks]
        axes.set_xticks(range(len(texts)), labels=texts)
        if slanted:
            for text in axes.get_xticklabels():
                text.set(rotation=35, ha="right", rotation_mode="anchor")
        if len(texts) > _ROOMY_TICKS:
            axes.tick_params(axis="x", labelsize=8.5)


def _thinned(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The points to draw: of each stretch of a long line the least and the greatest, in their order."""
    if len(x) <= 4 * _BUCKETS:
        return x, y
    ends = np.linspace(0, len(x), _BUCKETS + 1).astype(np.int64)
    keep: list[int] = []
    for start, end in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True):
        piece = y[start:end]
        if np.isnan(piece).all():
            keep.append(start)
        else:
            keep += sorted({start + int(np.nanargmin(piece)), start + int(np.nanargmax(piece))})
    return x[keep], y[keep]
