"""Which messages an output leaves out: more than its rate, and those that say nothing new."""

from __future__ import annotations

from math import atan2, hypot

from quavelet.core.units import DEG_PER_RAD, NS_PER_S
from quavelet.sinks.message import Four, Message, together

KEEP_ALIVE_S = 1.0


class Thinning:
    """Goes by the messages' own times, so it is the same on any clock.

    What a message that is left out says of flags and gaps is in the next one that goes.
    """

    def __init__(self, *, rate_hz: float = 0.0, dead_band_deg: float = 0.0, keep_alive_s: float = KEEP_ALIVE_S) -> None:
        """At most `rate_hz` messages a second on the average, 0 for all; none that has not turned by `dead_band_deg`
        since the last that went and is otherwise as it was, but one every `keep_alive_s`."""
        self._period_ns = round(NS_PER_S / rate_hz) if rate_hz else 0
        self._dead_band_deg = dead_band_deg
        self._keep_alive_ns = round(keep_alive_s * NS_PER_S)
        self._due_ns = 0
        self._before_ns = 0
        self._step_ns = 0
        self._last: Message | None = None
        self._waits: Message | None = None
        self.left_out = 0
        """Messages left out so far."""

    def take(self, message: Message) -> Message | None:
        """The message as it is to go, None where it is left out."""
        if not self._period_ns and not self._dead_band_deg:
            return message
        if self._waits is not None:
            message = together(self._waits, message)
        if self._is_early(message) or self._says_nothing_new(message):
            self._waits = message
            self.left_out += 1
            return None
        late_ns = message.t_ns - self._due_ns
        # The deadlines stay on their grid, so that an uneven rate of messages does not lower the mean.
        self._due_ns += self._period_ns if late_ns < self._period_ns else late_ns + self._period_ns
        self._waits, self._last = None, message
        return message

    def _is_early(self, message: Message) -> bool:
        """Whether the next message is likely to come closer to when one is due."""
        if self._last is not None:
            # From one message to the next, on the average of the last few.
            self._step_ns += (min(message.t_ns - self._before_ns, self._period_ns) - self._step_ns) // 8
        self._before_ns = message.t_ns
        return self._last is not None and 2 * (self._due_ns - message.t_ns) > self._step_ns

    def _says_nothing_new(self, message: Message) -> bool:
        last = self._last
        return (
            self._dead_band_deg > 0.0
            and last is not None
            and message.t_ns - last.t_ns < self._keep_alive_ns
            and not message.gap_ns
            and message.flags == last.flags
            and message.still == last.still
            and message.yaw == last.yaw
            and angle_between_deg(message.q, last.q) < self._dead_band_deg
        )


def angle_between_deg(a: Four, b: Four) -> float:
    """By how much two attitudes differ: the angle of the one rotation that makes b of a, deg."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    w = aw * bw + ax * bx + ay * by + az * bz
    x = aw * bx - ax * bw - ay * bz + az * by
    y = aw * by - ay * bw - az * bx + ax * bz
    z = aw * bz - az * bw - ax * by + ay * bx
    return DEG_PER_RAD * 2.0 * atan2(hypot(x, y, z), abs(w))
