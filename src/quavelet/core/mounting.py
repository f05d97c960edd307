"""How the chip lies in the body that it moves with, by axes: one table for the mathematics and for the words."""

from __future__ import annotations

from quavelet.core.instruction import FACES

Axes = tuple[str, str, str]
"""Which axis of the chip, "+x" to "-z", points along the body's x, y and z."""
Rows = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
AS_THE_CHIP: Axes = ("+x", "+y", "+z")


def rotation(axes: Axes) -> Rows:
    """The matrix that takes a vector in the chip's axes to the body's. Raises ValueError where there is none."""
    for face in axes:
        if face not in FACES:
            raise ValueError(f"'{face}' is no axis of the chip: give one of {', '.join(sorted(FACES))}")
    x, y, z = (_unit(face) for face in axes)
    across = (x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0])
    if across != z:
        raise ValueError(
            f"{', '.join(axes)} is how no chip can lie: the third axis must be the first crossed with the second, as "
            f"x, y, z are on the board"
        )
    return x, y, z


def called(face: str, axes: Axes) -> str:
    """An axis of the chip by the body's name: "+x" of the chip is "-y" of a body whose y is the chip's -x."""
    for name, along in zip("xyz", axes, strict=True):
        if along[1] == face[1]:
            return ("+" if along[0] == face[0] else "-") + name
    raise ValueError(f"'{face}' is none of {', '.join(sorted(FACES))}")


def _unit(face: str) -> tuple[float, float, float]:
    sign = 1.0 if face[0] == "+" else -1.0
    x, y, z = (sign if name == face[1] else 0.0 for name in "xyz")
    return x, y, z
