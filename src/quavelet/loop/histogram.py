"""A histogram of durations that costs the loop the same at every tick, however long it runs."""

from __future__ import annotations

from bisect import bisect_right
from math import ceil
from typing import Any

BINS_PER_DECADE = 20
RELATIVE_WIDTH = 10 ** (1 / BINS_PER_DECADE) - 1
"""How much the upper edge of a bin lies above its lower one: 12.2 %."""

EDGES_NS = tuple(round(1_000 * 10 ** (i / BINS_PER_DECADE)) for i in range(7 * BINS_PER_DECADE + 1))
"""Edges of the bins, 1 us to 10 s. Bin i counts EDGES_NS[i - 1] <= ns < EDGES_NS[i]; the first bin has no
lower edge, the last no upper one."""


class Histogram:
    """Counts durations in bins of equal ratio; memory and the time of `add` never grow.

    One thread adds; others may read meanwhile and see a state at most one `add` old.
    """

    __slots__ = ("_counts", "count", "max_ns", "min_ns")

    def __init__(self) -> None:
        self._counts = [0] * (len(EDGES_NS) + 1)
        self.count = 0
        self.min_ns = 0
        """The smallest duration, exact; 0 while there is none."""
        self.max_ns = 0
        """The largest duration, exact; 0 while there is none."""

    def add(self, ns: int) -> None:
        """Count one duration in ns."""
        self._counts[bisect_right(EDGES_NS, ns)] += 1
        if self.count == 0 or ns < self.min_ns:
            self.min_ns = ns
        if self.count == 0 or ns > self.max_ns:
            self.max_ns = ns
        self.count += 1

    @property
    def counts(self) -> tuple[int, ...]:
        """How many fell into each bin, one more than there are `EDGES_NS`."""
        return tuple(self._counts)

    def percentile(self, p: float) -> int:
        """The duration in ns that `p` percent (0 to 100) do not exceed, by nearest rank; 0 while there is none.

        It is the upper edge of the bin that holds that rank, kept within the exact extremes: never too
        small, and between 1 us and 10 s at most 12.2 % too large. Raises ValueError for another `p`.
        """
        if not 0 <= p <= 100:
            raise ValueError(f"a percentile lies between 0 and 100, not at {p}")
        counts = self.counts
        rank = max(1, ceil(p / 100 * sum(counts)))
        seen = 0
        for edge_ns, n in zip(EDGES_NS, counts, strict=False):
            seen += n
            if seen >= rank:
                return min(max(edge_ns, self.min_ns), self.max_ns)
        return self.max_ns

    def as_dict(self) -> dict[str, Any]:
        """Plain data: `count`, `min_ns`, `max_ns`, and `bins`, a [upper edge in ns, count] for each bin not empty.

        The bin without an upper edge has None there.
        """
        edges: tuple[int | None, ...] = (*EDGES_NS, None)
        bins = [[edge_ns, n] for edge_ns, n in zip(edges, self.counts, strict=True) if n]
        return {"count": self.count, "min_ns": self.min_ns, "max_ns": self.max_ns, "bins": bins}
