"""One HTML page that opens without a network: sections of sentences, tables and charts, light or dark as the reader
has it, and narrow enough for a telephone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from html import escape
from pathlib import Path
from tempfile import TemporaryFile
from typing import Literal

import numpy as np

from quavelet.core.errors import ImuError, SettingsError
from quavelet.drawing.chart import Chart

Mark = Literal["", "good", "bad", "doubt", "against"]


class PageError(ImuError):
    """A page or a picture cannot be written."""


@dataclass(frozen=True, slots=True)
class Cell:
    """A table's cell; `mark` colours it, the words say the same."""

    text: str
    mark: Mark = ""


@dataclass(frozen=True, slots=True)
class Table:
    """Columns whose number is in `numbers` are set to the right. A `folded` one shows its rows when asked; one of
    `cards` has, on a narrow screen, each row as a few lines with the names of the columns."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    _: KW_ONLY
    numbers: frozenset[int] = frozenset()
    folded: bool = False
    cards: bool = False


@dataclass(frozen=True, slots=True)
class Section:
    """One part of the page; `words` are paragraphs before its tables, `remarks` a list after its charts."""

    title: str
    words: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    charts: tuple[Chart, ...] = ()
    remarks: tuple[str, ...] = ()


_CSS = """
:root{--ink:#212529;--soft:#5c636a;--ground:#fff;--line:#dee2e6;--good:#1b7a43;--bad:#c02533;--doubt:#9a5a00;
--head:#f1f3f5}
@media(prefers-color-scheme:dark){:root{--ink:#dee2e6;--soft:#a3a9b0;--ground:#16181d;--line:#343a40;--good:#5dc78a;
--bad:#ff7b86;--doubt:#f0ad4e;--head:#20242b}}
*{box-sizing:border-box}
html{color-scheme:light dark;-webkit-text-size-adjust:100%}
body{margin:0 auto;max-width:76rem;padding:1rem;color:var(--ink);background:var(--ground);
font:1rem/1.5 system-ui,sans-serif;overflow-wrap:break-word}
h1{font-size:1.5rem;line-height:1.2;margin:.5rem 0}
h2{font-size:1.25rem;line-height:1.25;margin:2.5rem 0 .5rem;padding-top:.6rem;border-top:2px solid var(--line)}
h3{font-size:1rem;margin:1.5rem 0 .3rem}
p,ul{max-width:46rem}
summary{cursor:pointer;margin-top:1.5rem}
summary h3{display:inline}
nav ul{padding-left:1.2rem}
a{color:inherit}
.wide{overflow-x:auto;max-width:100%}
table{border-collapse:collapse;font-size:.875rem;line-height:1.35}
th{background:var(--head);text-align:left;font-weight:600;vertical-align:bottom}
th,td{padding:.3rem .6rem;border-bottom:1px solid var(--line)}
td{vertical-align:top;min-width:3.5rem}
td.long{min-width:14rem}
.n{text-align:right;font-variant-numeric:tabular-nums}
td.n{white-space:nowrap}
.good{color:var(--good)}.bad{color:var(--bad);font-weight:600}.doubt{color:var(--doubt)}.against{color:var(--bad)}
.charts{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,29rem),1fr));gap:1rem;margin:1rem 0}
figure{margin:0;min-width:0}
figure svg{width:100%;height:auto;display:block}
figcaption{font-size:.875rem;color:var(--soft);max-width:44rem}
@media(max-width:42rem){
.cards thead{display:none}
.cards tr{display:block;padding:.4rem 0;border-bottom:1px solid var(--line)}
.cards td{display:block;text-align:left;white-space:normal;border:0;padding:.05rem 0}
.cards td.n{display:inline-block;margin-right:1.2rem}
.cards td:empty{display:none}
.cards td[data-name]::before{content:attr(data-name) ": ";color:var(--soft);font-weight:400}
.cards td:first-child,.cards td:nth-child(2){display:inline;font-weight:600}
.cards td:first-child::before,.cards td:nth-child(2)::before{content:none}
.cards td:first-child::after{content:"  "}
.cards td:nth-child(2)::after{content:"\\A";white-space:pre}
.wide table:not(.cards) td:first-child{position:sticky;left:0;background:var(--ground);max-width:9rem}
}
footer{margin-top:3rem;color:var(--soft);font-size:.875rem}
"""


def significant(value: float, digits: int) -> str:
    """`value` with so many digits that count, without an exponent where that can be read."""
    if value == 0.0 or not 1e-6 <= abs(value) < 1e7:
        return f"{value:.{digits}g}"
    return np.format_float_positional(value, precision=digits, unique=False, fractional=False, trim="-")


def html_page(title: str, words: Sequence[str], sections: Sequence[Section], *, foot: str) -> str:
    """The page's text. Raises SettingsError where a chart is to be drawn and matplotlib is not there."""
    parts = [f"<h1>{escape(title)}</h1>", *_paragraphs(words)]
    if len(sections) > 1:
        links = "".join(f'<li><a href="#s{k}">{escape(s.title)}</a></li>' for k, s in enumerate(sections))
        parts.append(f"<nav><ul>{links}</ul></nav>")
    for k, section in enumerate(sections):
        parts += [f'<section id="s{k}">', *_section(section), "</section>"]
    parts.append(f"<footer>{escape(foot)}</footer>")
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_CSS}</style></head>\n<body>\n"
        + "\n".join(parts)
        + "\n</body></html>\n"
    )


def write_pictures(charts: Sequence[Chart], folder: Path) -> None:
    """Each chart as NAME.svg and NAME.png. Raises PageError or SettingsError."""
    check_drawing()
    from quavelet.drawing import plot

    colours = plot.colours_of(charts)
    for chart in charts:
        write(folder / f"{chart.name}.svg", plot.svg_file(plot.svg(chart, colours)).encode())
        write(folder / f"{chart.name}.png", plot.png(chart, colours))


def write(path: Path, data: bytes) -> None:
    """Write a file, and the folder it is in. Raises PageError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    except OSError as error:
        raise PageError(f"{path} cannot be written ({error.strerror}): give another place") from error


def check_place(path: Path) -> None:
    """Raise PageError where a page could not be written, found out by trying, before the long work and not after it."""
    if path.is_dir():
        raise PageError(f"{path} is a folder: give the path of a file")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise PageError(f"{path} cannot be written ({error.strerror}): give another place") from error


def check_drawing() -> None:
    """Raise SettingsError where matplotlib is not there, before the long work and not after it."""
    try:
        import quavelet.drawing.plot  # noqa: F401
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "matplotlib":
            raise
        raise SettingsError("plots need matplotlib: pip install 'quavelet[report]', or ask for no page") from error


def _section(section: Section) -> Iterable[str]:
    yield f"<h2>{escape(section.title)}</h2>"
    yield from _paragraphs(section.words)
    for table in section.tables:
        yield from _table(table)
    if section.charts:
        check_drawing()
        from quavelet.drawing import plot

        colours = plot.colours_of(section.charts)
        yield '<div class="charts">'
        for chart in section.charts:
            drawn = plot.svg(chart, colours).replace("<svg ", f'<svg role="img" aria-label="{escape(chart.title)}" ', 1)
            note = f"<figcaption>{escape(chart.note)}</figcaption>" if chart.note else ""
            yield f"<figure>{drawn}{note}</figure>"
        yield "</div>"
    if section.remarks:
        yield "<h3>Remarks</h3><ul>" + "".join(f"<li>{escape(text)}</li>" for text in section.remarks) + "</ul>"


def _paragraphs(words: Iterable[str]) -> list[str]:
    return [f"<p>{escape(text)}</p>" for text in words]


def _table(table: Table) -> Iterable[str]:
    right = [' class="n"' if k in table.numbers else "" for k in range(len(table.head))]
    title = f"<h3>{escape(table.title)}</h3>"
    yield f"<details><summary>{title} ({len(table.rows)} rows)</summary>" if table.folded else title
    kind = ' class="cards"' if table.cards else ""
    yield f'<div class="wide"><table{kind}><thead><tr>'
    yield "".join(f"<th{right[k]}>{escape(name)}</th>" for k, name in enumerate(table.head)) + "</tr></thead><tbody>"
    for row in table.rows:
        names = table.head if table.cards else [""] * len(row)
        cells = (_cell(cell, names[k], number=k in table.numbers) for k, cell in enumerate(row))
        yield "<tr>" + "".join(cells) + "</tr>"
    yield "</tbody></table></div>" + ("</details>" if table.folded else "")


def _cell(cell: Cell, name: str, *, number: bool) -> str:
    kinds = " ".join(kind for kind in ("n" if number else "", "long" if len(cell.text) > 40 else "", cell.mark) if kind)
    named = f' class="{kinds}"' if kinds else ""
    named += f' data-name="{escape(name)}"' if name else ""
    return f"<td{named}>{escape(cell.text)}</td>"
