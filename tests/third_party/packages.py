"""Drivers from PyPI, each in a folder of its own: two of them own the same package name."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest


def installed(requirement: str, folder: Path) -> Path:
    """The folder with the package, unchanged and without what it depends on; skips where it cannot be had."""
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(folder), requirement]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    except subprocess.TimeoutExpired:
        pytest.skip(f"{requirement} cannot be installed here: pip found no answer within 120 s")
    if done.returncode:
        last = (done.stderr.strip() or "pip said nothing").splitlines()[-1]
        pytest.skip(f"{requirement} cannot be installed here: {last}")
    return folder
