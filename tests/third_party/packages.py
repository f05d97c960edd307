"""Drivers from PyPI, each in a folder of its own: two of them own the same package name."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

_refused: dict[tuple[str, ...], str] = {}


def installed(folder: Path, *requirements: str) -> Path:
    """The folder with the packages, unchanged and with nothing they depend on but what is asked for.

    Skips the test where they cannot be had.
    """
    if requirements not in _refused:
        reason = _install(folder, requirements)
        if reason is None:
            return folder
        _refused[requirements] = reason
    pytest.skip(f"{' '.join(requirements)} cannot be installed here: {_refused[requirements]}")


def _install(folder: Path, requirements: tuple[str, ...]) -> str | None:
    """Why it did not work."""
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(folder), *requirements]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    except subprocess.TimeoutExpired:
        return "pip found no answer within 120 s"
    return (done.stderr.strip() or "pip said nothing").splitlines()[-1] if done.returncode else None
