"""Which sample a pulse belongs to, found anew where the chip's samples have moved."""

from __future__ import annotations

from quavelet.bus.protocol import Edge
from quavelet.core.health import Health
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.pulses import Pulses
from quavelet.mpu6050.timebase import TimeBase

PERIOD_NS = 5_000_000
BEGIN_NS = 1_000_000_000


def test_pulses_found_anew_in_the_drain_that_lost_them_keep_the_weight_of_the_old():
    base = TimeBase(nominal_period_s=PERIOD_NS / 1e9)
    pulses = Pulses(base, health=Health())

    def drained(number: int, *, moved_ns: int = 0, gap: bool = False) -> int:
        """A drain a millisecond after the last two of `number` samples; the time of the last one."""
        edges = tuple(Edge(BEGIN_NS + k * PERIOD_NS + moved_ns, k) for k in (number - 1, number))
        at_ns = edges[-1].t_ns + 1_000_000
        pulses.hear(edges, gap=gap)
        pulses.match(number, Drain(0, at_ns, at_ns + 100_000, 0, 28, bytes(28)))
        return edges[-1].t_ns

    for number in range(2, 402, 2):
        assert abs(base.time_ns(number) - drained(number)) <= 1 or number == 2
    last_ns = drained(500, moved_ns=2_000_000, gap=True)
    assert pulses.in_use
    assert abs(base.time_ns(500) - last_ns) <= 1
