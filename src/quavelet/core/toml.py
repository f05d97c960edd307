"""Reading TOML that anybody may have written: bounded in size and depth, and one kind of error for all that is none."""

from __future__ import annotations

import tomllib
from pathlib import Path

LARGEST_BYTES = 1_000_000
DEEPEST = 20


def read_toml(path: Path) -> dict[str, object]:
    """The tables of a file. Raises OSError, and ValueError with what is wrong in words."""
    return parse_toml(read_text(path))


def read_text(path: Path) -> str:
    """A file of a size that can be. Raises OSError, and ValueError with what is wrong in words."""
    with path.open("rb") as file:
        content = file.read(LARGEST_BYTES + 1)
    if len(content) > LARGEST_BYTES:
        raise ValueError(f"it has more than {LARGEST_BYTES} bytes")
    return content.decode("utf-8")


def parse_toml(text: str) -> dict[str, object]:
    """The tables of a text. Raises ValueError with what is wrong in words: also for what `tomllib` does not expect,
    a depth that ends the interpreter's stack, or a number of more digits than it converts."""
    try:
        tables: dict[str, object] = tomllib.loads(text)
    except RecursionError:
        raise ValueError("it is nested far too deep") from None
    level: list[object] = [tables]
    for _ in range(DEEPEST):
        level = [inner for outer in level for inner in _inside(outer)]
        if not level:
            return tables
    raise ValueError("it is nested far too deep")


def _inside(outer: object) -> list[object]:
    if isinstance(outer, dict):
        return [value for value in outer.values() if isinstance(value, dict | list)]
    return [value for value in outer if isinstance(value, dict | list)] if isinstance(outer, list) else []
