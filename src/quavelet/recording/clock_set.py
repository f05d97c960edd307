"""UTC that is set while a file is written: its times are told by one instant of both clocks, so another file begins."""

from __future__ import annotations

from quavelet.core.units import NS_PER_S
from quavelet.core.wall_clock import OffsetNs

SET_NS = NS_PER_S
"""By so much at least: a time server moves a clock gently, and may set it by less."""
NOT_AGAIN_NS = 60 * NS_PER_S
"""Two programs that fight over the clock make no more than a file a minute."""


class ClockSet:
    """Whether UTC was set, or the machine suspended, since the file began.

    offset_ns   UTC less the clock of what is recorded
    """

    def __init__(self, offset_ns: OffsetNs) -> None:
        self._offset_ns = offset_ns
        self._begun_ns = offset_ns()
        self._set_ns: int | None = None

    def begin(self) -> int:
        """A file begins; the offset at its beginning."""
        self._begun_ns = self._offset_ns()
        return self._begun_ns

    def since_begin(self, t_ns: int) -> bool:
        """Whether another is to begin with the item of that time."""
        if self._set_ns is not None and 0 <= t_ns - self._set_ns < NOT_AGAIN_NS:
            return False
        offset_ns = self._offset_ns()
        was_set = abs(offset_ns - self._begun_ns) >= SET_NS
        if was_set:
            self._begun_ns, self._set_ns = offset_ns, t_ns
        return was_set
