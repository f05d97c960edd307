"""One fault that was ordered: when it was noticed, by what, and when all was well again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import msgspec
import numpy as np

from quavelet.bus.protocol import KnowsTruth, OfferedFault, OrderedFault
from quavelet.core.quaternion import inclination_between
from quavelet.core.units import DEG_PER_RAD, NS_PER_MS, NS_PER_S
from quavelet.sinks.message import Four, Message

USUAL = ("samples", "samples_lost", "drains", "fifo_empty", "slow_queries", "rate_out_of_bounds", "records_damaged")
"""Counters that tell of no fault, or rise on a busy host without one."""
NO_DATA, NO_DATA_NS = "no_data", 250 * NS_PER_MS
"""No message for so long is noticed by whoever looks."""
PAUSE_NS = 100 * NS_PER_MS
"""After a longer one what came before it was only what the chip still had."""
SURE_NS = NS_PER_S // 2
"""So long nothing new may come for all to be well again."""
UNNOTICED_NS, AT_MOST_NS = 3 * NS_PER_S, 30 * NS_PER_S
SIGNS = 3
"""Named in the sentence."""
_NOT_OF_IT = frozenset({"heading_suspect"})
"""A slow turn raises it too."""


class FaultTold(msgspec.Struct, frozen=True, kw_only=True):
    """What a viewer is told of a fault; times in ms, None for what has not been, or never was.

    at_ns         when it began, of the clock of the messages; when it was asked for, before it began
    lasted_ms     from its beginning to its end
    noticed_ms    from its beginning to the first flag, counter or silence that told of it
    data_ms       from its end to the first message after it
    recovered_ms  from its end to the first message without any flag that came with it
    how           the flags and counters that told of it, in the order in which they did
    before_deg    how far the tilt was off at most in the second before it; None where the truth is not known
    worst_deg     the same from its beginning until all was well, in messages without a flag of it
    flagged_deg   the same in messages with one; None where there were none
    over          whether nothing more is waited for
    """

    n: int
    name: str
    title: str
    at_ns: int
    lasted_ms: float | None = None
    noticed_ms: float | None = None
    data_ms: float | None = None
    recovered_ms: float | None = None
    how: tuple[str, ...] = ()
    before_deg: float | None = None
    worst_deg: float | None = None
    flagged_deg: float | None = None
    over: bool = False
    says: str = ""


class FaultCase:
    """Follows a fault from its order on. `flags` are those of the message before; `attitudes` those of the last second.

    order  the number that the bus gave
    over   whether nothing more is waited for
    """

    def __init__(
        self,
        n: int,
        fault: OfferedFault,
        *,
        order: int,
        now_ns: int,
        flags: Iterable[str],
        counters: Mapping[str, int],
        attitudes: Sequence[tuple[int, Four]],
    ) -> None:
        self.order = order
        self.over = False
        self._n = n
        self._fault = fault
        self._asked_ns = now_ns
        self._known = frozenset(flags) | _NOT_OF_IT
        self._counters = dict(counters)
        self._attitudes = [(t_ns, q, False) for t_ns, q in attitudes]
        self._how: dict[str, None] = {}
        self._began_ns: int | None = None
        self._ended_ns: int | None = None
        self._noticed_ns: int | None = None
        self._data_ns: int | None = None
        self._clean_ns: int | None = None
        self._message_ns = now_ns
        self._off_deg: tuple[float | None, float | None, float | None] = (None, None, None)

    def look(self, counters: Mapping[str, int], ordered: OrderedFault | None, *, now_ns: int) -> None:
        """The counters as they are, and then what has become of the order."""
        if ordered is not None:
            self._began_ns, self._ended_ns = ordered.began_ns, ordered.ended_ns
        if self._began_ns is None:
            # What was counted until then was not of it.
            self._counters = dict(counters)
            met_nothing = self._ended_ns is not None or now_ns - self._asked_ns > UNNOTICED_NS
            self.over = self.over or met_nothing
            return
        risen = [name for name, n in counters.items() if n > self._counters.get(name, 0) and name not in USUAL]
        if now_ns - max(self._message_ns, self._began_ns) > NO_DATA_NS:
            risen.append(NO_DATA)
        self._counters = dict(counters)
        self._notice(risen, now_ns)
        self._look_whether_over(now_ns)

    def see(self, message: Message, *, now_ns: int) -> None:
        """A message that came at `now_ns`."""
        new = [flag for flag in message.flags if flag not in self._known]
        self._attitudes.append((message.t_ns, message.q, bool(new)))
        pause_ns, self._message_ns = now_ns - self._message_ns, now_ns
        if self._began_ns is None or message.t_ns < self._began_ns:
            return
        self._notice(new, now_ns)
        if self._ended_ns is not None and message.t_ns > self._ended_ns:
            if self._data_ns is None or pause_ns > PAUSE_NS:
                self._data_ns = now_ns
            if not new and (self._clean_ns is None or pause_ns > PAUSE_NS):
                self._clean_ns = now_ns
            self._look_whether_over(now_ns)

    def measure(self, bus: object) -> None:
        """Once it is over: by how much the attitude was wrong, where the bus knows the truth."""
        if self._began_ns is None or not isinstance(bus, KnowsTruth) or not self._attitudes:
            return
        t_ns = np.array([t for t, _, _ in self._attitudes])
        flagged = np.array([flagged for _, _, flagged in self._attitudes])
        off_deg = DEG_PER_RAD * inclination_between(bus.attitude(t_ns), np.array([q for _, q, _ in self._attitudes]))
        before = t_ns < self._began_ns
        self._off_deg = _most(off_deg[before]), _most(off_deg[~before & ~flagged]), _most(off_deg[~before & flagged])

    def told(self) -> FaultTold:
        """How it stands."""
        began_ns = self._began_ns
        noticed = self._noticed_ns is not None
        told = FaultTold(
            n=self._n,
            name=self._fault.name,
            title=self._fault.title,
            at_ns=self._asked_ns if began_ns is None else began_ns,
            lasted_ms=_ms(began_ns, self._ended_ns),
            noticed_ms=_ms(began_ns, self._noticed_ns),
            data_ms=_ms(self._ended_ns, self._data_ns),
            recovered_ms=_ms(self._ended_ns, self._clean_ns) if noticed and self.over else None,
            how=tuple(self._how),
            before_deg=self._off_deg[0],
            worst_deg=self._off_deg[1],
            flagged_deg=self._off_deg[2],
            over=self.over,
        )
        return msgspec.structs.replace(told, says=_in_words(told, began=began_ns is not None))

    def _notice(self, signs: Iterable[str], now_ns: int) -> None:
        for sign in signs:
            self._how[sign] = None
            self._clean_ns = None
            if self._noticed_ns is None:
                self._noticed_ns = now_ns

    def _look_whether_over(self, now_ns: int) -> None:
        if self._ended_ns is None:
            return
        since_ns = now_ns - self._ended_ns
        well = self._noticed_ns is not None and self._clean_ns is not None and now_ns - self._clean_ns > SURE_NS
        unnoticed = self._noticed_ns is None and since_ns > UNNOTICED_NS
        self.over = self.over or well or unnoticed or since_ns > AT_MOST_NS


def _ms(from_ns: int | None, to_ns: int | None) -> float | None:
    return None if from_ns is None or to_ns is None else round((to_ns - from_ns) / NS_PER_MS, 1)


def _most(off_deg: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float | None:
    return None if len(off_deg) == 0 or np.isnan(off_deg).any() else round(float(off_deg.max()), 3)


def _in_words(told: FaultTold, *, began: bool) -> str:
    if not began:
        return "It met no transfer, and did nothing." if told.over else "It happens with the next transfer."
    tilt = _tilt_in_words(told)
    if told.noticed_ms is None:
        return f"Not noticed.{tilt}" if told.over else "Not noticed yet."
    signs = [sign.replace("_", " ") for sign in told.how]
    more = f" and {len(signs) - SIGNS} more" if len(signs) > SIGNS else ""
    noticed = f"Noticed after {told.noticed_ms:.0f} ms ({', '.join(signs[:SIGNS])}{more})"
    if not told.over:
        return f"{noticed}; it is not over yet." if told.lasted_ms is None else f"{noticed}; not all is well yet."
    if told.recovered_ms is None:
        return f"{noticed}; {AT_MOST_NS // NS_PER_S} s after its end there is still a flag of it.{tilt}"
    return f"{noticed}; all well {told.recovered_ms:.0f} ms after its end.{tilt}"


def _tilt_in_words(told: FaultTold) -> str:
    if told.worst_deg is None:
        return ""
    before = "" if told.before_deg is None else f" ({told.before_deg:.2f} deg before it)"
    flagged = "" if told.flagged_deg is None else f", and {told.flagged_deg:.2f} deg where that was flagged"
    return f" The tilt was {told.worst_deg:.2f} deg off at most{before}{flagged}."
