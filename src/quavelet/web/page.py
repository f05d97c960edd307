"""The live page as a part of the network: what every viewer gets, and what each may ask for."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import msgspec

from quavelet.core.clock import Clock
from quavelet.core.errors import ImuError, SettingsError
from quavelet.core.units import NS_PER_S
from quavelet.loop.histogram import Histogram
from quavelet.settings.web import WebSettings
from quavelet.sinks.message import Message
from quavelet.sinks.status import Status
from quavelet.sinks.thinning import Thinning
from quavelet.web.ability import Ability, HasFiles, HasPast
from quavelet.web.access import Access, is_loopback, own_address, token_at, token_path
from quavelet.web.assets import read_assets
from quavelet.web.frames import VERSION, ability_frame, encoded, frame, lateness_of, message_frame
from quavelet.web.health_words import Lately, words_of
from quavelet.web.history import History
from quavelet.web.viewers import STALLED_S, Viewer, Viewers

if TYPE_CHECKING:
    from quavelet.web.server import Server

log = logging.getLogger(__name__)
T = TypeVar("T")

LOOK_S = 0.1
"""How often abilities are looked at, and viewers for whether they still take anything."""
STATUS_EVERY = 10
SAID = 20
"""Sentences of the program that who comes later gets, too."""
JUMP_NS = 5 * NS_PER_S
"""Time that a message is later than gaps and samples explain: it was not lost, the player has gone elsewhere."""


class Asked(msgspec.Struct, frozen=True):
    """What the page may say: a ping, or something that an ability is to do."""

    n: int = 0
    ability: str = ""
    what: str = ""
    values: dict[str, object] = {}
    ping: int | None = None


class WebPage:
    """Serves the page while it is open; see `Part`. All but `tell` is called on the network's thread.

    src, name   the bus and the service
    status      the service as it is at this moment
    abilities   what can be done from the page, looked at when it opens; whoever made them ends them
    talk        says one sentence to the person: where the page is
    clock       of the messages
    environ     has the places that systemd gives
    lateness    of the loop
    stalled_s   a viewer that takes nothing for so long is dropped
    patience_s, heartbeat_s   as `Server` has them

    Raises SettingsError where aiohttp is missing.
    """

    name = "page"

    def __init__(
        self,
        settings: WebSettings,
        *,
        src: str,
        name: str,
        status: Callable[[], Status],
        abilities: Sequence[Ability] = (),
        talk: Callable[[str], None],
        clock: Clock,
        environ: Mapping[str, str],
        lateness: Callable[[], Histogram] = Histogram,
        stalled_s: float = STALLED_S,
        patience_s: float = 10.0,
        heartbeat_s: float = 10.0,
    ) -> None:
        if find_spec("aiohttp") is None:
            raise SettingsError("web.listen: the page needs aiohttp: `pip install 'quavelet[web]'`, or leave it out")
        self.viewers = Viewers(settings.viewers, stalled_s=stalled_s)
        self._settings = settings
        self._src = src
        self._service = name
        self._status = status
        self._abilities = abilities
        self._talk = talk
        self._clock = clock
        self._environ = environ
        self._patience_s = patience_s
        self._heartbeat_s = heartbeat_s
        self._lateness = lateness
        self._by_name: dict[str, Ability] = {}
        self._with_past: list[tuple[Ability, Callable[[Message], Iterable[Message] | None]]] = []
        self._states: dict[str, bytes] = {}
        self._mistaken: set[str] = set()
        self._history = History()
        self._thinning = Thinning(rate_hz=settings.rate_hz)
        self._latest: Message | None = None
        self._flags: dict[str, None] = {}
        self._lately = Lately()
        self._last_ns: int | None = None
        self._said: deque[str] = deque(maxlen=SAID)
        self._to_say: deque[str] = deque(maxlen=SAID)
        self._server: Server | None = None
        self._ticking: asyncio.Task[None] | None = None
        self._token: str | None = None

    @property
    def port(self) -> int:
        """Where it listens, once it is open."""
        return self._server.port if self._server else self._settings.address[1]

    @property
    def connections(self) -> int:
        """All that are open, viewers and others."""
        return self._server.connections if self._server else 0

    def tell(self, text: str) -> None:
        """Let the viewers know what the program says; may be called from any thread, and returns at once."""
        self._to_say.append(text)

    async def open(self) -> None:
        """Begin to listen. Raises OSError where the address is taken or not ours, SettingsError for a token's file."""
        from quavelet.web.server import Server

        host, port = self._settings.address
        self.begin()
        path = token_path(self._settings, name=self._service, environ=self._environ)
        is_told = self._token is not None
        made = False
        if self._token is None:
            self._token, made = ("", False) if is_loopback(host) else token_at(path)
        # A quarter of a second on a small machine, and the others go on meanwhile.
        assets = await asyncio.to_thread(read_assets)
        self._server = Server(
            self, Access(self._token, port=port), assets, patience_s=self._patience_s, heartbeat_s=self._heartbeat_s
        )
        await self._server.open(host, port)
        self._ticking = asyncio.get_running_loop().create_task(self._tick())
        if not is_told:
            self._tell_where(host, "" if made or not self._token else f"; its token is in {path}", made=made)

    def begin(self) -> None:
        """Take the abilities that there are from here on."""
        self._by_name = {ability.name: ability for ability in self._abilities}
        self._with_past = [(ability, ability.past) for ability in self._abilities if isinstance(ability, HasPast)]

    def write(self, message: Message) -> bool:
        past = self._past_of(message)
        if past is not None or self._has_jumped(message):
            self._begin_anew(past or ())
        self._last_ns = message.t_ns
        for ability in self._by_name.values():
            self._guarded(ability, partial(ability.see, message))
        self._history.add(message)
        self._flags |= dict.fromkeys(message.flags)
        taken = self._thinning.take(message)
        if taken is None:
            return False
        self._latest = taken
        return self.viewers.offer(taken, self._frame_of)

    async def close(self) -> None:
        if self._ticking is not None:
            ticking, self._ticking = self._ticking, None
            ticking.cancel()
            await asyncio.wait([ticking])
        if self._server is not None:
            server, self._server = self._server, None
            await server.close()

    def greet(self, viewer: Viewer) -> None:
        """All that one who comes later is to know."""
        status = self._status()
        viewer.send(self._hello(status))
        viewer.send(self._history.frame())
        for name in self._by_name:
            viewer.send(ability_frame(name, self._state_of(name)))
        for text in self._said:
            viewer.send(_talk(text))
        viewer.send(self._status_frame(status))
        if self._latest is not None:
            viewer.send(self._frame_of(self._latest))

    def heard(self, viewer: Viewer, text: str) -> None:
        """Do what a viewer asks. Raises ValueError where that is no JSON object of the right kinds."""
        try:
            asked = msgspec.json.decode(text, type=Asked)
        except (msgspec.DecodeError, RecursionError, UnicodeError) as error:
            raise ValueError(str(error)) from None
        if asked.ping is not None:
            viewer.send(frame("pong", n=asked.ping, now_ns=self._clock.now_ns()))
            return
        ok, said = self._done(asked)
        viewer.send(frame("answer", n=asked.n, ok=ok, text=said))
        self._look_at_abilities()

    def file(self, name: str) -> Path | None:
        """The file that an ability has under that name."""
        for ability in self._by_name.values():
            if isinstance(ability, HasFiles):
                path = self._guarded(ability, partial(ability.open_file, name))
                if path is not None:
                    return path
        return None

    def _done(self, asked: Asked) -> tuple[bool, str]:
        ability = self._by_name.get(asked.ability)
        if ability is None:
            return False, "that cannot be done here: load the page again"
        try:
            return True, str(ability.do(asked.what, asked.values))
        except (ImuError, ValueError) as error:
            return False, str(error)
        except Exception as error:  # noqa: BLE001
            self._mistake(f"ability {ability.name}", error)
            return False, "that failed by a mistake in the program: its log says where"

    def _has_jumped(self, message: Message) -> bool:
        last_ns = self._last_ns
        return last_ns is not None and (message.t_ns <= last_ns or message.t_ns - message.gap_ns - last_ns > JUMP_NS)

    def _past_of(self, message: Message) -> Iterable[Message] | None:
        pasts = (self._guarded(ability, partial(past, message)) for ability, past in self._with_past)
        return next((past for past in pasts if past is not None), None)

    def _begin_anew(self, past: Iterable[Message]) -> None:
        """Time has jumped: what was before is no past of what comes."""
        self._thinning = Thinning(rate_hz=self._settings.rate_hz)
        self._history.clear()
        for message in past:
            self._history.add(message)
        self.viewers.send(self._history.frame())

    async def _tick(self) -> None:
        looked = 0
        while True:
            await asyncio.sleep(LOOK_S)
            looked += 1
            try:
                self._look(is_due=looked % STATUS_EVERY == 0)
            except Exception as error:  # noqa: BLE001
                self._mistake("status", error)

    def _look(self, *, is_due: bool) -> None:
        """What is to be seen to ten times a second; is_due: once a second."""
        while self._to_say:
            text = self._to_say.popleft()
            self._said.append(text)
            self.viewers.send(_talk(text))
        self.viewers.drop_stalled(asyncio.get_running_loop().time())
        if len(self.viewers):
            self._look_at_abilities()
            if is_due:
                self.viewers.send(self._status_frame(self._status()))
        if is_due:
            self._flags.clear()

    def _look_at_abilities(self) -> None:
        for name in self._by_name:
            state = self._state_of(name)
            if state != self._states.get(name):
                self._states[name] = state
                self.viewers.send(ability_frame(name, state))

    def _state_of(self, name: str) -> bytes:
        ability = self._by_name[name]
        return self._guarded(ability, lambda: encoded(ability.state())) or b"null"

    def _about(self, ability: Ability) -> bytes:
        return self._guarded(ability, lambda: encoded(ability.about())) or b"null"

    def _guarded(self, ability: Ability, step: Callable[[], T]) -> T | None:
        """What it gives; None where the ability has a mistake in its code, which is told of once and ends nothing."""
        try:
            return step()
        except Exception as error:  # noqa: BLE001
            self._mistake(f"ability {ability.name}", error)
            return None

    def _mistake(self, what: str, error: Exception) -> None:
        """In the log, the first time only."""
        if what not in self._mistaken:
            self._mistaken.add(what)
            log.error("the page's %s has a mistake in its code", what, exc_info=error)

    def _frame_of(self, message: Message) -> bytes:
        return message_frame(message, now_ns=self._clock.now_ns())

    def _hello(self, status: Status) -> bytes:
        abouts = {name: msgspec.Raw(self._about(ability)) for name, ability in self._by_name.items()}
        return frame(
            "hello",
            v=VERSION,
            version=status.version,
            name=self._service,
            src=self._src,
            fake=status.fake,
            now_ns=self._clock.now_ns(),
            abilities=abouts,
        )

    def _status_frame(self, status: Status) -> bytes:
        words = words_of(status, flags=self._flags, grown=self._lately.grown(status))
        lateness = lateness_of(self._lateness())
        return frame("status", s=status, words=words, lateness=lateness, viewers=self.viewers.status())

    def _tell_where(self, host: str, kept: str, *, made: bool) -> None:
        reached = own_address(host)
        shown = f"[{reached}]" if ":" in reached else reached
        # What is behind # a browser does not send: it stands in no log of a proxy.
        fragment = f"#token={self._token}" if made else ""
        self._talk(f"the page is at http://{shown}:{self.port}/{fragment}{kept}")


def _talk(text: str) -> bytes:
    return frame("talk", level="info", text=text)
