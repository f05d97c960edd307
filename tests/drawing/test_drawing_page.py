"""The page stands by itself, says what the rows say, and is the same each time."""

from __future__ import annotations

import re
import sys
from html.parser import HTMLParser

import numpy as np
import pytest

from quavelet.core.errors import SettingsError
from quavelet.drawing import plot
from quavelet.drawing.chart import Chart, Curve
from quavelet.drawing.page import Cell, PageError, Section, Table, check_drawing, html_page, write, write_pictures

CHART = Chart(
    "walk",
    "A walk & <its> error",
    "time, s",
    "error, deg",
    (
        Curve("method 1", np.arange(4000.0), np.sin(np.arange(4000.0))),
        Curve("truth", np.arange(2.0), np.zeros(2), dashed=True),
    ),
    note="Nothing is to be seen.",
)
ROWS = ((Cell("one of <several>"), Cell("0.601 deg", "bad")),)
SECTION = Section(
    "Walks",
    ("What was walked.",),
    (Table("Open", ("what", "got"), ROWS), Table("Folded", ("what", "got"), ROWS, folded=True, cards=True)),
    (CHART,),
    ("A remark.",),
)
VOID = {"meta", "br", "link", "img", "input", "hr"}


class Balanced(HTMLParser):
    """Collects what is open; what is closed out of order is an error."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text: list[str] = []

    def handle_starttag(self, tag, attrs):
        del attrs
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def page_of(*sections: Section) -> str:
    return html_page("Papers", ("Words.",), sections, foot="foot")


def text_of(page: str) -> str:
    parser = Balanced()
    parser.feed(page)
    assert parser.open == []
    return " ".join(parser.text)


def test_the_page_closes_all_it_opens():
    text = text_of(page_of(SECTION, Section("more")))
    for words in (
        "Words.",
        "one of <several>",
        "0.601 deg",
        "A walk & <its> error",
        "Nothing is to be seen.",
        "A remark.",
    ):
        assert words in text


def test_the_page_fetches_nothing_and_runs_nothing():
    page = page_of(SECTION)
    assert re.findall(r"\b(?:src|href)=\"(?!#)[^\"]*", page) == []
    assert "<script" not in page
    assert "@import" not in page
    assert re.findall(r"url\((?!#)", page) == []


def test_what_a_user_wrote_is_text_and_no_markup():
    cells = ((Cell("<b>1</b>"), Cell("&")),)
    page = page_of(Section("<i>", ("<u>",), (Table("<s>", ("<q>", "2"), cells),), (), ("<tt>",)))
    for tag in ("<b>", "<i>", "<u>", "<s>", "<q>", "<tt>"):
        assert tag not in page


def test_the_same_result_gives_the_same_page_and_pictures(tmp_path):
    assert page_of(SECTION) == page_of(SECTION)
    for folder in ("a", "b"):
        write_pictures(SECTION.charts, tmp_path / folder)
    for name in ("walk.svg", "walk.png"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert (tmp_path / "a" / "walk.png").read_bytes().startswith(b"\x89PNG")


def test_letters_have_the_colour_of_the_page_they_stand_in():
    picture = plot.svg(CHART, plot.colours_of([CHART]))
    assert "currentColor" in picture
    assert not re.search(r"fill: #(000000|212529|fff)", picture)


def test_a_label_has_one_colour_in_all_charts_and_a_truth_none_of_its_own():
    x = np.arange(2.0)
    first = Chart("a", "", "", "", (Curve("truth", x, x, dashed=True), Curve("P", x, x), Curve("PID", x, x)))
    second = Chart("b", "", "", "", (Curve("PID", x, x), Curve("wavelet", x, x)))
    colours = plot.colours_of([first, second])
    assert list(colours) == ["P", "PID", "wavelet"]
    assert len(set(colours.values())) == 3


def test_what_was_fitted_is_drawn_over_the_points_in_the_letters_colour():
    x = np.arange(3.0)
    chart = Chart("fit", "", "", "", (Curve("fitted", x, x, dotted=True), Curve("measured", x, x)), kind="points")
    colours = plot.colours_of([chart])
    assert list(colours) == ["measured"]
    picture = plot.svg(chart, colours)
    dotted = re.search(r"<path[^>]*stroke-dasharray[^>]*stroke: currentColor", picture)
    assert dotted is not None
    assert dotted.start() > picture.index(colours["measured"])


def test_a_round_thing_is_drawn_round():
    turn = np.linspace(0.0, 2.0 * np.pi, 73)
    chart = Chart("circle", "", "", "", (Curve("", 9.0 * np.cos(turn), 9.0 * np.sin(turn), dashed=True),), equal=True)
    path = re.search(r'<path d="([^"]*)"[^>]*stroke-dasharray', plot.svg(chart, {}))
    assert path is not None
    x, y = np.array([float(word) for word in re.findall(r"[-\d.]+", path[1])]).reshape(-1, 2).T
    assert np.ptp(x) == pytest.approx(np.ptp(y), rel=1e-3)


def test_a_band_is_a_shade_of_its_curves_colour():
    x = np.arange(3.0)
    chart = Chart("band", "", "", "", (Curve("a", x, x, band=(x - 1.0, x + 1.0)),))
    colours = plot.colours_of([chart])
    assert f"fill: {colours['a']}; fill-opacity" in plot.svg(chart, colours)


def test_charts_that_have_no_label_in_common_begin_with_the_same_colours():
    x = np.arange(2.0)
    methods = Chart("a", "", "", "", tuple(Curve(str(k), x, x) for k in range(7)))
    axes = Chart("b", "", "", "", tuple(Curve(axis, x, x) for axis in "xyz"))
    colours = plot.colours_of([methods, axes, methods])
    assert [colours[axis] for axis in "xyz"] == [colours[str(k)] for k in range(3)]
    assert len({colours[str(k)] for k in range(7)}) == 7


def test_a_spike_in_a_long_line_is_drawn():
    y = np.zeros(200_000)
    y[123_456] = 7.0
    curve = Curve("", np.arange(200_000.0), y)
    x, thin = plot._thinned(curve.x, curve.y)
    assert len(x) < 3000
    assert x[thin == 7.0].tolist() == [123_456.0]
    assert (np.diff(x) > 0).all()


@pytest.mark.parametrize("kind", ["line", "points", "bars"])
def test_gaps_and_empty_curves_are_drawn_without_complaint(kind):
    x = np.arange(3.0)
    curves = (Curve("a", x, np.full(3, np.nan)), Curve("b", x, np.array([1.0, np.nan, 2.0])), Curve("", x[:0], x[:0]))
    chart = Chart("gaps", "Gaps", "", "deg", curves, kind=kind, ticks=("one", "two", "three"))
    assert "<svg" in plot.svg(chart, plot.colours_of([chart]))


def test_without_matplotlib_the_sentence_says_what_to_install(monkeypatch):
    monkeypatch.delitem(sys.modules, "quavelet.drawing.plot")
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(SettingsError, match=r"pip install 'quavelet\[report\]'"):
        check_drawing()


def test_a_page_that_cannot_be_written_is_one_sentence(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(PageError, match=r"cannot be written .*another place"):
        write(tmp_path / "file" / "index.html", b"")
