"""What is done to a machine, a step at a time: said in words, then done."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from quavelet.core.errors import ImuError

Run = Callable[[Sequence[str]], None]


class InstallError(ImuError):
    """The service cannot be put in place or taken away."""


@dataclass(frozen=True, slots=True)
class Step:
    """words say what is done, before it is done; if_failed says what follows where that is not the end of it all."""

    words: str
    do: Callable[[], None] | None = None
    if_failed: str = ""


def carry_out(steps: Iterable[Step], *, say: Callable[[str], None], dry_run: bool) -> None:
    """Say each step, then do it. Raises InstallError at the first that fails; what is done stays."""
    for step in steps:
        say(step.words)
        if step.do is None or dry_run:
            continue
        try:
            step.do()
        except OSError as error:
            raise InstallError(f"{error.filename}: {error.strerror}: nothing more was done") from error
        except InstallError as error:
            if not step.if_failed:
                raise
            say(f"{error}: {step.if_failed}")


def run_command(command: Sequence[str]) -> None:
    """Raises InstallError where it is not there or does not end well."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError as error:
        raise InstallError(f"{command[0]} is not installed") from error
    if done.returncode:
        why = (done.stderr or done.stdout).strip().splitlines()
        raise InstallError(f"{' '.join(command)}: {why[-1] if why else f'ended with {done.returncode}'}")


def write_file(path: Path, text: str) -> None:
    """As a whole or not at all, readable by all whatever the umask."""
    for folder in reversed(path.parents):
        if not folder.exists():
            folder.mkdir()
            folder.chmod(0o755)
    trial = path.with_name(f".{path.name}.{os.getpid()}")
    trial.write_text(text, encoding="utf-8")
    trial.chmod(0o644)
    trial.replace(path)
