"""The program that a unit is to start: where it is, and whether the service's user can run it."""

from __future__ import annotations

import re
import shutil
import stat
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path

import quavelet

HIDDEN = tuple(map(Path, ("/home", "/root", "/run/user", "/tmp", "/var/tmp")))
"""What the unit does not let its program see (ProtectHome, PrivateTmp)."""
REMEDY = (
    "put it where every user can read it: sudo python3 -m venv /opt/quavelet/venv && "
    "sudo /opt/quavelet/venv/bin/pip install quavelet && sudo /opt/quavelet/venv/bin/quavelet service install"
)


@dataclass(frozen=True, slots=True)
class Program:
    """path is what ExecStart names; parts are the files and folders without which it does not run."""

    path: Path
    parts: tuple[Path, ...] = ()

    @property
    def in_unit(self) -> str:
        """The path as ExecStart takes it."""
        return f'"{self.path}"' if " " in str(self.path) else str(self.path)

    def why_not(self) -> str | None:
        """Why a service cannot run it, and what to do; None where it can."""
        if not self.path.is_absolute() or not re.fullmatch(r"[\w/.+@ -]+", str(self.path)):
            return f"the path {self.path} cannot stand in a unit: {REMEDY}"
        for part in (self.path, *self.parts):
            for folder in HIDDEN:
                if part.is_relative_to(folder):
                    return f"{part} lies in {folder}, which the service does not see: {REMEDY}"
            shut = _shut(part)
            if shut is not None:
                return f"{shut} is not there, or shut to the service's user: {REMEDY}"
        return None


def this_program() -> Program:
    """The quavelet that runs."""
    called = Path(shutil.which(sys.argv[0]) or sys.argv[0]).absolute()
    path = called if called.name == "quavelet" else Path(sysconfig.get_path("scripts"), "quavelet")
    # What the links lead to must be there too: a venv's python is often a link into a home directory.
    parts = (
        path.resolve(),
        Path(sys.executable).absolute(),
        Path(sys.executable).resolve(),
        Path(quavelet.__path__[0]),
    )
    return Program(path, parts)


def _shut(part: Path) -> Path | None:
    """The first on the way to `part` that is not there, or that others may not enter or read; None where they may."""
    for place in (*reversed(part.parents), part):
        try:
            mode = place.stat().st_mode
        except OSError:
            return place
        wanted = 0o001 if place != part else 0o005 if stat.S_ISDIR(mode) else 0o004
        if mode & wanted != wanted:
            return place
    return None
