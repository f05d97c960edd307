"""The ability "play": a recording in place of a chip, with pause, seek and speed."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from math import isfinite

import msgspec

from quavelet.core.clock import Clock
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.recording.overview import Overview
from quavelet.recording.player import Played, Player
from quavelet.sinks.message import Message, message_of

AGAIN_NS = 2 * NS_PER_S
"""How often the overview is sent while it grows,"""
SENT_FOR_NS = 250 * NS_PER_MS
"""and for how long it stands in the state then, which is looked at ten times a second."""


class PlayingAbout(msgspec.Struct, frozen=True, kw_only=True):
    """What is played; the overview goes as far as it is known."""

    file: str
    length_s: float
    overview: Overview


class PlayingState(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """As `PlayerState`; the overview stands in it where it has grown, for a moment."""

    t_s: float
    length_s: float
    known_s: float
    speed: float
    paused: bool
    ended: bool
    wanted_s: float | None = None
    says: str = ""
    overview: Overview | None = None


class Playing:
    """An `Ability` that plays `player`'s recording as messages, each handed to `publish` on the player's thread.

    clock    of the page, for how often the overview is sent
    latest   the message played last, None before the first
    """

    name = "play"

    def __init__(self, player: Player, *, publish: Callable[[Message], None], clock: Clock) -> None:
        self.latest: Message | None = None
        self._player = player
        self._publish = publish
        self._clock = clock
        self._pasts: deque[tuple[Message, list[Message]]] = deque()
        self._overview_ns = clock.now_ns()
        self._overview_known_ns = -1
        self._overview: Overview | None = None

    def give(self, played: Played) -> None:
        """Let the player's next block be a message."""
        src = f"replay:{played.src}"
        message = message_of(played.attitude, src=src)
        if played.before is not None:
            self._pasts.append((message, [message_of(block, src=src) for block in played.before]))
        self.latest = message
        self._publish(message)

    def about(self) -> PlayingAbout:
        state = self._player.state()
        return PlayingAbout(
            file=self._player.path.name, length_s=round(state.length_s, 3), overview=self._player.overview()
        )

    def state(self) -> PlayingState:
        state = self._player.state()
        return PlayingState(
            t_s=round(state.t_s, 3),
            length_s=round(state.length_s, 3),
            known_s=round(state.known_s, 3),
            speed=state.speed,
            paused=state.paused,
            ended=state.ended,
            wanted_s=state.wanted_s,
            says=state.says,
            overview=self._overview_now(),
        )

    def see(self, message: Message) -> None:
        del message

    def past(self, message: Message) -> list[Message] | None:
        """What was before a message that was sought; see `HasPast`."""
        # A message that a full queue has lost keeps its past from none that comes after it.
        while self._pasts and any(message is sought for sought, _ in self._pasts):
            sought, past = self._pasts.popleft()
            if sought is message:
                return past
        return None

    def do(self, what: str, values: Mapping[str, object]) -> str:
        player = self._player
        match what:
            case "pause":
                player.pause()
                return "paused"
            case "resume":
                if player.state().ended:
                    player.seek(0.0)
                player.resume()
                return "playing"
            case "seek":
                t_s = number_of(values, "t_s")
                player.seek(t_s)
                return f"going to {max(0.0, t_s):.1f} s"
            case "speed":
                x = number_of(values, "x")
                player.set_speed(x)
                return f"playing at {x:g} times the speed"
        raise ValueError("a recording cannot do that: ask for pause, resume, seek or speed")

    def close(self) -> None:
        self._player.close()

    def _overview_now(self) -> Overview | None:
        """The overview where it has grown and is to be sent, or was so just now."""
        now_ns, first_pass = self._clock.now_ns(), self._player.first_pass
        known_ns = first_pass.known_ns
        due = first_pass.done or now_ns - self._overview_ns >= AGAIN_NS
        if due and known_ns != self._overview_known_ns:
            self._overview_ns, self._overview_known_ns = now_ns, known_ns
            self._overview = self._player.overview()
        elif now_ns - self._overview_ns >= SENT_FOR_NS:
            self._overview = None
        return self._overview


def number_of(values: Mapping[str, object], key: str) -> float:
    """A number that a stranger gave. Raises ValueError where it is none."""
    value = values.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{key} is no number: give one")
    try:
        number = float(value)
    except OverflowError:
        number = float("inf")
    if not isfinite(number):
        raise ValueError(f"{key} is no number: give one that is not so large")
    return number
