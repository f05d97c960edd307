"""Files of ours on a machine: put there, replaced, taken away. What a person wrote into one is kept beside it."""

from __future__ import annotations

import shutil
from itertools import count
from pathlib import Path

from quavelet.service.steps import Step, write_file

KEPT = ".old"
"""Behind the name of what was there; neither systemd nor udev reads such a file."""


def put(path: Path, text: str, what: str) -> Step:
    """The file with this text; one that differs is kept."""
    if not path.exists():
        return Step(f"write {path}: {what}", lambda: write_file(path, text))
    if holds(path, text):
        return Step(f"{path} is there, as shipped")
    kept = _kept_name(path)

    def replace() -> None:
        _keep(path, kept)
        write_file(path, text)

    return Step(f"replace {path}, which differs and is kept as {kept.name}: {what}", replace)


def take(path: Path, text: str) -> Step:
    """The file away; one that is not as shipped, which is `text`, is kept."""
    if not path.exists() or holds(path, text):
        return gone(path)
    kept = _kept_name(path)

    def remove() -> None:
        _keep(path, kept)
        path.unlink()

    return Step(f"remove {path}, which differs and is kept as {kept.name}", remove)


def gone(path: Path) -> Step:
    """The file or folder away, whatever is in it."""
    if not path.exists():
        return Step(f"{path} is not there")
    if path.is_dir():
        return Step(f"remove {path} and all that is in it", lambda: shutil.rmtree(path))
    return Step(f"remove {path}", path.unlink)


def kept_of(path: Path) -> list[Path]:
    """What was kept of that file."""
    return sorted(path.parent.glob(f"{path.name}{KEPT}*"))


def holds(path: Path, text: str) -> bool:
    """Whether that is what the file holds."""
    return path.read_text(encoding="utf-8", errors="replace") == text


def _kept_name(path: Path) -> Path:
    """A free name beside it, or that of a copy which is there."""
    names = (path.with_name(f"{path.name}{KEPT}{n if n > 1 else ''}") for n in count(1))
    return next(name for name in names if not name.exists() or name.read_bytes() == path.read_bytes())


def _keep(path: Path, kept: Path) -> None:
    if not kept.exists():
        shutil.copy2(path, kept, follow_symlinks=False)
