"""Paths as a person writes them."""

from __future__ import annotations

import os
from pathlib import Path


def expanded(text: str) -> Path:
    """The path with `~` as the home it means; of a user who is not there it stays as it is, and will not be found.

    (`Path.expanduser` raises RuntimeError for that.)
    """
    return Path(os.path.expanduser(text))  # noqa: PTH111
