"""A die whose temperature somebody changes from outside."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hw_fakes.world.imperfections import FloatArray, Imperfections


@dataclass(frozen=True, slots=True)
class Heated(Imperfections):
    """Imperfections of a board whose surroundings can be made warmer; a chip at work has to `recompute` after it.

    Until the first change the temperature goes as `Imperfections` has it.
    """

    _changes: list[tuple[float, float, float, float]] = field(default_factory=list)

    def goes_to(self, temp_degc: float, *, from_s: float, within_s: float) -> None:
        """From `from_s` on the die goes to this temperature, the rest of the way falling by e each `within_s`."""
        begins = float(self.temperature_degc(np.array([from_s]))[0])
        self._changes.append((from_s, begins, temp_degc, within_s))

    def temperature_degc(self, t_s: FloatArray) -> FloatArray:
        course = Imperfections.temperature_degc(self, t_s)
        for from_s, begins, ends, within_s in self._changes:
            later = ends + (begins - ends) * np.exp(-np.maximum(t_s - from_s, 0.0) / within_s)
            course = np.where(t_s >= from_s, later, course)
        return course
