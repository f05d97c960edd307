"""The figures in the room's README are those that come out."""

from __future__ import annotations

from pathlib import Path

import denoise_figures as figures
import pytest

README = Path(__file__).parents[2] / "src" / "quavelet" / "denoise" / "README.md"


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def rows_of_readme(heading: str) -> dict[str, list[str]]:
    """The first table after a heading, by its first column, without its two top lines."""
    lines = README.read_text(encoding="utf-8").split(f"## {heading}\n")[1].splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("|"))
    table = lines[start + 2 :]
    end = next((i for i, line in enumerate(table) if not line.startswith("|")), len(table))
    return {row[0]: row[1:] for row in map(cells, table[:end])}


def assert_same(measured: list[str], heading: str, rel: float) -> None:
    printed = rows_of_readme(heading)
    assert len(printed) == len(measured)
    for name, *values in map(cells, measured):
        assert len(values) == len(printed[name]), name
        for value, said in zip(values, printed[name], strict=True):
            if "/" in value:
                assert value == said, name
            else:
                assert float(value) == pytest.approx(float(said), rel=rel), name


def test_delay_noise_and_distortion_are_as_the_readme_says():
    assert_same(figures.effect_rows(), "What it does", 0.03)


@pytest.mark.slow
def test_the_tilt_is_as_the_readme_says():
    assert_same(figures.tilt_rows(), "What the attitude has of it", 0.03)
