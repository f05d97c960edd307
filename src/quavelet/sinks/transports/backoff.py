"""How long to wait before the next try."""

from __future__ import annotations

import random
from collections.abc import Callable


class Backoff:
    """Twice as long each time, and never the same for two of a fleet that lost the same broker.

    first_s    the first wait, s; most_s the longest
    uniform    a number in [0, 1); the wait is between half and the whole of what it would be
    """

    def __init__(
        self, *, first_s: float = 1.0, most_s: float = 60.0, uniform: Callable[[], float] = random.random
    ) -> None:
        self.most_s = most_s
        self._first_s = first_s
        self._uniform = uniform
        self._next_s = first_s

    def wait_s(self, *, slow: bool = False) -> float:
        """How long to wait this time; `slow`: as long as can be, since only a person can mend it."""
        whole_s = self.most_s if slow else self._next_s
        self._next_s = min(self.most_s, 2.0 * self._next_s)
        return max(min(self._first_s, self.most_s), whole_s * (0.5 + 0.5 * self._uniform()))

    def reset(self) -> None:
        """It has worked: begin with the first again."""
        self._next_s = self._first_s
