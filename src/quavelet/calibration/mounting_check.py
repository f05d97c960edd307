"""Is the chip mounted as the settings say? Told by gravity from two poses: level, and with the front lifted.

A level body has its z up, and with its front lifted up leans towards its x: so each pose shows one axis, as a direction
in the chip, and the third follows. Which way the body looks does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from quavelet.core.blocks import FloatArray
from quavelet.core.instruction import FACES
from quavelet.core.mounting import Axes, rotation
from quavelet.core.units import DEG_PER_RAD, RAD_PER_DEG, STANDARD_GRAVITY_M_S2

WINDOW_S = 1.0
"""A pose is the mean of so long."""
ACCEL_SD_M_S2, GYRO_SD_RAD_S = 0.03 * STANDARD_GRAVITY_M_S2, 4.0 * RAD_PER_DEG
"""A hand that holds still has less; one that moves more."""
DRIFT_DEG = 2.0
"""Between the halves of the window."""
SIZE_M_S2 = 0.15 * STANDARD_GRAVITY_M_S2
"""By so much the force may differ from gravity: a zero-g offset of 50 to 80 mg, a scale 3 % off (PS 6.2), a margin."""
LEVEL_DEG = 25.0
"""A level body has an axis of the chip so near to the vertical, or it is not mounted by axes."""
LIFTED_DEG = 20.0, 60.0
"""What is asked for, and taken as soon as it is held."""
LEAST_DEG, MOST_DEG = 15.0, 70.0
ASKEW_DEG = 30.0
"""Between two axes of the chip are 90 degrees: farther than this from the nearer one, and it might have been either."""

Verdict = Literal["right", "wrong", "unclear"]
Three = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Judgement:
    """says: what was found, in words. axes: of the mounting that is right, where one was found that is not in force."""

    verdict: Verdict
    says: str
    axes: Axes | None = None

    @property
    def toml(self) -> str:
        """The lines for the settings file, "" for none."""
        if self.axes is None:
            return ""
        return "[mounting]\n" + "".join(f'{name} = "{face}"\n' for name, face in zip("xyz", self.axes, strict=True))


class Held:
    """The last second of force and rate, in the body's axes of the mounting in force."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, ...]] = []
        self._t_ns: list[int] = []

    def clear(self) -> None:
        self._rows, self._t_ns = [], []

    def add(self, t_ns: int, accel_m_s2: Three, gyro_rad_s: Three) -> None:
        self._rows.append((*accel_m_s2, *gyro_rad_s))
        self._t_ns.append(t_ns)
        while t_ns - self._t_ns[0] > WINDOW_S * 1e9:
            del self._rows[0], self._t_ns[0]

    def up(self) -> FloatArray | None:
        """The vertical (3,) as a unit vector, None where it was not held still all the time."""
        rows = np.array(self._rows)
        if len(rows) < 8 or self._t_ns[-1] - self._t_ns[0] < 0.9 * WINDOW_S * 1e9:
            return None
        sd = rows.std(axis=0)
        if (sd[:3] > ACCEL_SD_M_S2).any() or (sd[3:] > GYRO_SD_RAD_S).any():
            return None
        half = len(rows) // 2
        before, after = rows[:half, :3].mean(axis=0), rows[half:, :3].mean(axis=0)
        mean = rows[:, :3].mean(axis=0)
        size = float(np.linalg.norm(mean))
        if abs(size - STANDARD_GRAVITY_M_S2) > SIZE_M_S2 or angle_deg(before, after) > DRIFT_DEG:
            return None
        up: FloatArray = mean / size
        return up


def angle_deg(a: FloatArray, b: FloatArray) -> float:
    """Between two directions (3,)."""
    return DEG_PER_RAD * float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def why_not_level(level: FloatArray, axes: Axes) -> str:
    """Why the vertical (3,) in the body's axes of the mounting `axes` is not that of a body that lies level; "" where
    it may be."""
    face, off_deg = _nearest(_in_chip(level, axes), FACES)
    if off_deg <= LEVEL_DEG:
        return ""
    return (
        f"it does not lie level: of the chip's axes {face} is nearest to up, and leans by {off_deg:.0f} degrees; "
        "lay it level, or mount the chip along the body's axes"
    )


def judged(level: FloatArray, lifted: FloatArray, *, axes: Axes) -> Judgement:
    """Whether the mounting `axes`, which is in force, is that of a body whose vertical (3,), in the body's axes, was
    `level` when it lay and `lifted` with its front up."""
    why = why_not_level(level, axes)
    if why:
        return Judgement("unclear", _sentence(why))
    by_deg = angle_deg(level, lifted)
    if not LEAST_DEG <= by_deg <= MOST_DEG:
        least, most = LIFTED_DEG
        only = " only" if by_deg < LEAST_DEG else ""
        says = f"It was lifted by {by_deg:.0f} degrees{only}: lift it by {least:.0f} to {most:.0f}."
        return Judgement("unclear", says)
    up, lean = _in_chip(level, axes), _in_chip(lifted, axes)
    z, _ = _nearest(up, FACES)
    x, off_deg = _nearest(lean - (lean @ up) * up, [face for face in FACES if face[1] != z[1]])
    if off_deg > ASKEW_DEG:
        return Judgement("unclear", "It was lifted askew, between two of the chip's axes: lift the front alone.")
    y = _face_of(np.cross(_along(z), _along(x)))
    found: Axes = (x, y, z)
    if found == axes:
        return Judgement("right", f"[mounting] is right: the chip's {x} points to the front, and its {z} up.")
    wrong = []
    if z != axes[2]:
        wrong.append(f"the chip's {z} points up, where [mounting] has {axes[2]}")
    if x != axes[0]:
        wrong.append(f"the chip's {x} points to what was lifted, where [mounting] has {axes[0]}")
    says = (
        f"[mounting] is wrong: {' and '.join(wrong)}. Put these lines into the settings and start anew; if it was not "
        "the front that was lifted, check again."
    )
    return Judgement("wrong", says, found)


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def _in_chip(body: FloatArray, axes: Axes) -> FloatArray:
    chip: FloatArray = np.array(rotation(axes)).T @ body
    return chip


def _along(face: str) -> FloatArray:
    """The chip's axis as a unit vector (3,)."""
    return np.array([(1.0 if face[0] == "+" else -1.0) * (name == face[1]) for name in "xyz"])


def _face_of(axis: FloatArray) -> str:
    return max(FACES, key=lambda face: float(_along(face) @ axis))


def _nearest(direction: FloatArray, faces: list[str] | tuple[str, ...]) -> tuple[str, float]:
    """The axis of the chip that is nearest to the direction (3,), and how far it is off in degrees."""
    face = max(faces, key=lambda face: float(_along(face) @ direction))
    return face, angle_deg(_along(face), direction)
