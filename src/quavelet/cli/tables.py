"""Tables on stdout: as wide as the terminal, or in a file or a pipe one line a row, for grep."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TextIO

from rich.console import Console
from rich.table import Table
from rich.text import Text

from quavelet.drawing.page import Cell

_STYLES = {"": "", "good": "green", "bad": "bold red", "doubt": "yellow", "against": "red"}
_PIPE_WIDTH = 10_000


def console_for(stream: TextIO) -> Console:
    """A console of the terminal's width, or so wide that nothing is broken."""
    return Console(file=stream, width=None if stream.isatty() else _PIPE_WIDTH, highlight=False)


def table_of(head: Sequence[str], rows: Sequence[Sequence[Cell]], numbers: frozenset[int]) -> Table:
    """The cells as a table without lines; the columns in `numbers` are set to the right."""
    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
    for k, name in enumerate(head):
        table.add_column(name, justify="right" if k in numbers else "left")
    for row in rows:
        table.add_row(*(Text(cell.text, style=_STYLES[cell.mark]) for cell in row))
    return table
