"""`quavelet reproduce`: the five papers' tables beside what this program gets."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, nullcontext, suppress
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.text import Text

from quavelet.cli import exits
from quavelet.cli.run import talk
from quavelet.cli.tables import console_for, table_of
from quavelet.drawing.page import check_drawing, html_page, write, write_pictures
from quavelet.study import papers, reproduction
from quavelet.study.experiment import Effort, Experiment, Result, Row
from quavelet.study.running import Step, run_all

Papers = Annotated[list[str] | None, typer.Argument(metavar="000|001|002|003|004|all", help="Which papers [all].")]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object a row, a line each.")]
Out = Annotated[
    Path | None,
    typer.Option("--out", help="A folder for the figures (SVG, PNG) and one page, index.html.", show_default=False),
]
Quick = Annotated[
    bool, typer.Option("--quick", help="Fewer runs: within a minute, rows that need all of them unjudged.")
]


def reproduce(paper: Papers = None, json: AsJson = False, out: Out = None, quick: Quick = False) -> None:
    """Work the papers' experiments through and print every row of their tables beside what came out.

    All five take some four minutes on two processors. Exit code 6 where a row is outside its band.
    """
    experiments = [papers.experiment(number) for number in _numbers(paper or [])]
    if out is not None:
        check_drawing()
    effort = Effort.QUICK if quick else Effort.FULL
    show = _show_json if json else _show_tables
    results = []
    with _progress(experiments) as tell, closing(run_all(experiments, effort, tell=tell)) as finished:
        for experiment, result in finished:
            # A reader who has seen enough (`| head`) ends it, but not the page that is to be written.
            with suppress(typer.Exit) if out else nullcontext():
                show(experiment, result)
            results.append((experiment, result))
    if out is not None:
        _write(results, effort, out)
    failed = [f"{one.paper} {row.id}" for one, result in results for row in reproduction.failed_rows(result.rows)]
    if failed:
        talk(f"{len(failed)} rows are outside their bands: {', '.join(dict.fromkeys(failed))}")
        raise typer.Exit(exits.VERDICT_FAILED)


def _numbers(wanted: Sequence[str]) -> list[str]:
    unknown = [number for number in wanted if number not in (*papers.NUMBERS, "all")]
    if unknown:
        raise typer.BadParameter(f"'{unknown[0]}' is not a paper: give {', '.join(papers.NUMBERS)} or all")
    return [number for number in papers.NUMBERS if not wanted or number in wanted or "all" in wanted]


def _write(results: Sequence[tuple[Experiment, Result]], effort: Effort, folder: Path) -> None:
    sections = [reproduction.summary(results), *(reproduction.section(*one) for one in results)]
    for _, result in results:
        write_pictures(result.charts, folder)
    page = html_page(
        "Five papers, reproduced",
        ("What five papers on attitude from inertial sensors print, and what quavelet gets in the same experiments.",),
        sections,
        foot=f"quavelet {version('quavelet')}, {effort.value} effort. The same figures each time: quavelet reproduce",
    )
    write(folder / "index.html", page.encode())
    talk(f"{folder / 'index.html'} written, with {sum(len(result.charts) for _, result in results)} figures beside it")


@contextmanager
def _progress(experiments: Sequence[Experiment]) -> Iterator[Callable[[Step], None]]:
    """Where the work's steps go: bars on a terminal, else nowhere."""
    console = Console(stderr=True)
    began_s = time.monotonic()
    columns = (TextColumn("{task.description}"), BarColumn(20), TextColumn("{task.fields[at]}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bars:
        tasks: dict[str, TaskID] = {
            one.paper: bars.add_task(one.paper, total=1.0, at="waiting", start=False) for one in experiments
        }

        def tell(step: Step) -> None:
            task = tasks[step.paper]
            bars.start_task(task)
            bars.update(task, completed=step.share, at=step.what)

        yield tell
    if not console.is_terminal:
        talk(f"{', '.join(one.paper for one in experiments)} took {time.monotonic() - began_s:.0f} s")


def _show_json(experiment: Experiment, result: Result) -> None:
    for row in result.rows:
        exits.put(msgspec.json.encode(_plain(experiment, row)).decode())


def _plain(experiment: Experiment, row: Row) -> dict[str, str | float | bool]:
    """A row as plain data; what is not finite becomes null."""
    return {
        "paper": experiment.paper,
        "id": row.id,
        "what": row.what,
        "printed": row.printed,
        "got": row.got,
        "low": row.low,
        "high": row.high,
        "unit": row.unit,
        "verdict": row.verdict.value,
        "reading": row.reading,
        "note": row.note,
        "judged": row.judged,
        "passed": row.passed,
    }


def _show_tables(experiment: Experiment, result: Result) -> None:
    console = console_for(sys.stdout)
    with console.capture() as written:
        console.print(Text(f"{experiment.paper}  {experiment.title}", style="bold"))
        console.print(Text(experiment.headline))
        for table in reproduction.tables(result):
            console.print()
            # The last column, why, is on the page: it would leave no room for the figures here.
            rows = [row[:-1] for row in table.rows]
            console.print(table_of(table.head[:-1], rows, table.numbers))
        for row in reproduction.failed_rows(result.rows):
            console.print(Text(f"outside its band: {row.id} {row.what}. {row.note}", style="red"))
        for remark in result.remarks:
            console.print(Text(f"- {remark}"))
    exits.put("\n".join(line.rstrip() for line in written.get().splitlines()) + "\n")
