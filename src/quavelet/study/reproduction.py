"""A paper's result in words: its rows as text, and its part of the page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import isinf, isnan

from quavelet.drawing.page import Cell, Mark, Section, Table, significant
from quavelet.study.experiment import Experiment, Result, Row, Verdict

PRINTED_HEAD = ("id", "what", "printed", "got", "band", "verdict", "why")
ACCEPTANCE_HEAD = ("id", "what", "got", "band", "passed", "why")
OTHER_HEAD = ("id", "what", "got", "why")
FOLDED_FROM = 12
_MARKS: dict[Verdict, Mark] = {
    Verdict.REPRODUCED: "good",
    Verdict.READING: "doubt",
    Verdict.REFUTED: "against",
    Verdict.NONE: "",
}


def printed_rows(rows: Iterable[Row]) -> list[Row]:
    """The rows of the paper's own tables."""
    return [row for row in rows if row.verdict is not Verdict.NONE]


def acceptance_rows(rows: Iterable[Row]) -> list[Row]:
    """Our own rows that have a band."""
    return [row for row in rows if row.verdict is Verdict.NONE and row.judged]


def other_rows(rows: Iterable[Row]) -> list[Row]:
    """Our own rows that are only shown."""
    return [row for row in rows if row.verdict is Verdict.NONE and not row.judged]


def failed_rows(rows: Iterable[Row]) -> list[Row]:
    """The rows outside their bands."""
    return [row for row in rows if not row.passed]


def got_text(row: Row) -> str:
    """What this program got, with its unit."""
    return "none" if isnan(row.got) else f"{significant(row.got, 4)} {row.unit}".rstrip()


def band_text(row: Row) -> str:
    """The band: "0.01 to 0.014", "<= 0.055", "" where there is none."""
    if not row.judged:
        return ""
    if isinf(row.low):
        return f"<= {significant(row.high, 4)}"
    return (
        f">= {significant(row.low, 4)}"
        if isinf(row.high)
        else f"{significant(row.low, 4)} to {significant(row.high, 4)}"
    )


def passed_text(row: Row) -> str:
    """ "yes", "NO", "" where the row is shown and not judged."""
    return "" if not row.judged else "yes" if row.passed else "NO"


def tables(result: Result) -> tuple[Table, ...]:
    """What the paper prints beside what we got; what must hold; what else was measured. Empty ones are left out."""
    printed, ours, others = printed_rows(result.rows), acceptance_rows(result.rows), other_rows(result.rows)
    found = (
        _table("What the paper prints", PRINTED_HEAD, printed, frozenset({2, 3, 4})),
        _table("What must hold", ACCEPTANCE_HEAD, ours, frozenset({2, 3})),
        _table("What else was measured", OTHER_HEAD, others, frozenset({2}), folded=len(others) > FOLDED_FROM),
    )
    return tuple(table for table in found if table.rows)


def section(experiment: Experiment, result: Result) -> Section:
    """The paper's part of the page."""
    title = f"{experiment.paper}: {experiment.title}"
    return Section(title, (experiment.headline,), tables(result), result.charts, result.remarks)


def summary(results: Iterable[tuple[Experiment, Result]]) -> Section:
    """The first part of the page: how many rows of each paper came out how."""
    rows = []
    for experiment, result in results:
        printed, failed = printed_rows(result.rows), failed_rows(result.rows)
        counts = [sum(row.verdict is verdict for row in printed) for verdict in Verdict if verdict is not Verdict.NONE]
        judged = sum(row.judged for row in result.rows)
        names = ", ".join(dict.fromkeys(row.id for row in failed))
        held = f"{judged - len(failed)} of {judged}" + (f"; not: {names}" if failed else "")
        rows.append(
            (
                Cell(experiment.paper),
                Cell(experiment.title),
                *(Cell(str(count)) for count in counts),
                Cell(held, "bad" if failed else "good"),
            )
        )
    head = ("paper", "what it proposes", "reproduced", "only under a reading", "refuted", "within their bands")
    words = (
        "A figure that a paper prints stands beside what this program got. Reproduced: as printed. Only under a "
        "reading: by one reading of the text of several, or with noise tuned to it, and the row says which. Refuted: "
        "it does not follow, or is a slip. A band is where our own figure must be; it says nothing of the paper's.",
    )
    return Section(
        "Summary", words, (Table("All papers", head, tuple(rows), numbers=frozenset({2, 3, 4}), cards=True),)
    )


def _table(
    title: str, head: tuple[str, ...], rows: Sequence[Row], numbers: frozenset[int], *, folded: bool = False
) -> Table:
    # A row's cells may be more than the head has names: what is only shown has no band.
    cells = tuple((*_cells(row)[: len(head) - 1], Cell(_why(row))) for row in rows)
    return Table(title, head, cells, numbers=numbers, folded=folded, cards=True)


def _cells(row: Row) -> tuple[Cell, ...]:
    bad: Mark = "" if row.passed else "bad"
    got, band = Cell(got_text(row), bad), Cell(band_text(row), bad)
    if row.verdict is Verdict.NONE:
        return Cell(row.id), Cell(row.what), got, band, Cell(passed_text(row), "good" if row.passed else "bad")
    return Cell(row.id), Cell(row.what), Cell(row.printed), got, band, Cell(row.verdict.value, _MARKS[row.verdict])


def _why(row: Row) -> str:
    return f"{row.note.rstrip('.')}; reading: {row.reading}" if row.note and row.reading else row.note or row.reading
