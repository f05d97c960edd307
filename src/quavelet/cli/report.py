"""`quavelet report`: any recording through all methods side by side, on one page."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.text import Text

from quavelet.cli import exits, options
from quavelet.cli.run import talk
from quavelet.cli.tables import console_for, table_of
from quavelet.core.errors import RecordingError
from quavelet.drawing.noise import noise_table
from quavelet.drawing.page import Table, check_drawing, html_page, write
from quavelet.recording.recorded import load_recorded
from quavelet.settings import Settings
from quavelet.study.recording_report import Report, figures, method_table, section, work_through

Files = Annotated[list[Path], typer.Argument(help="Recordings: .qrec, or npz files of arrays.", show_default=False)]
Out = Annotated[Path, typer.Option("--out", help="Where the page goes.")]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object a recording, a line each.")]
ABOUT = (
    "Each recording worked through by the papers' methods and by the default, sample by sample as live; what each "
    "method is stands in the remarks below its pictures."
)


def report(
    files: Files,
    out: Out = Path("report.html"),
    config: options.Config = None,
    json: AsJson = False,
) -> None:
    """Run the papers' methods and the default over recordings: attitude, noise, and truth where a file carries it.

    All else is as recorded, or as --config says. The page opens without a network.
    """
    check_drawing()
    given = options.settings_of(None, None, config).settings if config else None
    sections, failures = [], []
    show = _show_json if json else _show_tables
    with _progress() as tell:
        for k, file in enumerate(files):
            try:
                found = _worked(file, given, tell)
            except RecordingError as error:
                failures.append(error)
                continue
            with suppress(typer.Exit):  # a reader who has seen enough (`| head`) does not end the page
                show(found)
            sections.append(section(found, f"r{k}"))
            if found.recorded.damage:
                failures.append(RecordingError(found.recorded.damage))
    if sections:
        page = html_page(
            _title(sections[0].title, len(sections)), (ABOUT,), sections, foot=f"quavelet {version('quavelet')}"
        )
        write(out, page.encode())
        talk(f"{out} written")
    for failure in failures:
        talk(str(failure))
    if failures:
        raise typer.Exit(exits.exit_code(failures[0]))


def _worked(file: Path, given: Settings | None, tell: Callable[[str], None]) -> Report:
    tell(f"{file.name}: reading")
    recorded = load_recorded(file)
    return work_through(recorded, given or recorded.settings or Settings(), tell=lambda at: tell(f"{file.name}: {at}"))


def _title(first: str, n: int) -> str:
    return f"quavelet report: {Path(first).name}" + (f" and {n - 1} more" if n > 1 else "")


@contextmanager
def _progress() -> Iterator[Callable[[str], None]]:
    """Where it is said what is being done: a line on a terminal, else nowhere."""
    console = Console(stderr=True)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as lines:
        task = lines.add_task("", total=None)
        yield lambda what: lines.update(task, description=what)


def _show_tables(report: Report) -> None:
    console = console_for(sys.stdout)
    tables: list[Table] = [method_table(report)] + ([noise_table(report.noise)] if report.noise else [])
    with console.capture() as written:
        console.print(Text(str(report.recorded.path), style="bold"))
        for table in tables:
            console.print()
            console.print(table_of(table.head, table.rows, table.numbers))
    exits.put("\n".join(line.rstrip() for line in written.get().splitlines()) + "\n")


def _show_json(report: Report) -> None:
    plain = {
        "file": str(report.recorded.path),
        "samples": len(report.imu),
        "seconds": report.recorded.seconds,
        "damage": report.recorded.damage,
        "methods": [{"name": ran.method.name, **figures(report, ran)} for ran in report.runs],
        "noise": [one.figures() for one in report.noise],
    }
    exits.put(msgspec.json.encode(plain).decode())
