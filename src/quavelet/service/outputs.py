"""The outputs of a service, its local socket, its figures for Prometheus and its page, all on one network thread."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import BinaryIO

from quavelet.core.clock import Clock
from quavelet.core.paths import expanded
from quavelet.core.wall_clock import OffsetNs
from quavelet.loop.histogram import Histogram
from quavelet.loop.hub import Hub, ItemSink, Policy, SubscriberStats
from quavelet.settings import OutputSettings, Settings
from quavelet.settings.service import AUTO, host_and_port
from quavelet.sinks.control import ControlSocket
from quavelet.sinks.json_lines import JsonLines
from quavelet.sinks.message import Message
from quavelet.sinks.metrics import MetricsEndpoint
from quavelet.sinks.network import DEPTH, Network, Part
from quavelet.sinks.output import thinning_of
from quavelet.sinks.outputs import make_encoding, make_output
from quavelet.sinks.plan import OutputPlan
from quavelet.sinks.status import OutputStatus, Status
from quavelet.sinks.stdout import Stdout
from quavelet.web.ability import Ability
from quavelet.web.page import WebPage

NETWORK = "network"
STDOUT = "stdout"
"""The subscriber whose end is the end of the service: nobody reads any more."""


class Outputs:
    """What [output], [service] and [web] of the settings ask for. Without anything of it there is no thread either."""

    def __init__(
        self,
        settings: Settings,
        *,
        name: str,
        messages: Hub[Message],
        clock: Clock,
        offset_ns: OffsetNs,
        talk: Callable[[str], None],
        status: Callable[[], Status],
        environ: Mapping[str, str],
        virtual: bool = False,
        abilities: Sequence[Ability] = (),
        lateness: Callable[[], Histogram] = Histogram,
    ) -> None:
        """virtual: on virtual time, where nothing is lost and "auto" is no socket. abilities are those of the page, and
        lateness that of the loop, which it shows. Raises SettingsError."""
        self._name = name
        self._messages = messages
        self._clock = clock
        self._offset_ns = offset_ns
        self._status = status
        self._virtual = virtual
        self._talk = talk
        self._network: Network | None = None
        self._wanted = settings.output
        self._outputs = {name: make_output(self.plan(name, wanted)) for name, wanted in _networked(settings).items()}
        self._others: list[Part] = []
        path = socket_path(settings, name=name, environ={} if virtual else environ)
        if path is not None:
            self._others.append(ControlSocket(path, status=status))
        if settings.service.metrics:
            host, port = host_and_port(settings.service.metrics, key="service.metrics")
            self._others.append(MetricsEndpoint(host, port, status=status))
        self.page: WebPage | None = None
        if settings.web.listen:
            self.page = WebPage(
                settings.web,
                src=settings.bus.name,
                name=name,
                status=status,
                abilities=abilities,
                talk=talk,
                clock=clock,
                environ=environ,
                lateness=lateness,
            )
            self._others.append(self.page)

    @property
    def latency(self) -> Histogram:
        """From the end of a drain to the send, over all outputs."""
        return self._network.latency if self._network else Histogram()

    def plan(self, name: str, settings: OutputSettings) -> OutputPlan:
        """What an output of this service is made from."""
        return OutputPlan(name, settings, self._name, self._status, self._offset_ns)

    def open(self) -> None:
        """Begin; all ends when the hub of the messages is closed."""
        parts = (*self._others, *self._outputs.values())
        if parts:
            self._begin().replace((), parts)

    def change(self, settings: Settings) -> None:
        """Put other outputs in the place of those that differ; the rest goes on. Returns at once.

        Raises SettingsError, and all is as it was.
        """
        wanted, before = _networked(settings), self._outputs
        kept = {name: part for name, part in before.items() if wanted.get(name) == self._wanted[name]}
        made = {name: make_output(self.plan(name, wanted[name])) for name in wanted if name not in kept}
        if made or len(kept) < len(before):
            network = self._network or self._begin()
            network.replace([part for name, part in before.items() if name not in kept], made.values())
        self._outputs, self._wanted = kept | made, settings.output

    def stdout(self, stream: BinaryIO) -> ItemSink[Message]:
        """What writes to standard output: the output that goes there, or else all messages in JSON."""
        for name, settings in self._wanted.items():
            if settings.to == STDOUT:
                plan = self.plan(name, settings)
                return Stdout(stream, make_encoding(plan), thinning_of(plan))
        return JsonLines(stream)

    def drained(self, message: Message, read_ns: int) -> None:
        """The message is of a drain that was read at the clock's `read_ns`."""
        if self._network is not None:
            self._network.drained(message.t_ns, read_ns)

    def statuses(self) -> list[OutputStatus]:
        """One of each output, in the order of the settings."""
        return [self._status_of(name, settings) for name, settings in self._wanted.items()]

    def tell(self, text: str) -> None:
        """Let who looks at the page know what the program says; returns at once."""
        if self.page is not None:
            self.page.tell(text)

    def _say(self, text: str) -> None:
        self._talk(text)
        self.tell(text)

    def _begin(self) -> Network:
        policy = Policy.WAIT if self._virtual else Policy.LOSE_OLDEST
        network = Network(talk=self._say, clock=self._clock, wait_for_room=self._virtual)
        network.start()
        self._messages.subscribe(NETWORK, network, depth=DEPTH, policy=policy)
        self._network = network
        return network

    def _status_of(self, name: str, settings: OutputSettings) -> OutputStatus:
        if settings.to == STDOUT:
            stdout = next((stats for stats in self._messages.stats() if stats.name == STDOUT), None)
            return _of_stdout(name, settings, stdout)
        output = self._outputs.get(name)
        if output is None:
            # Asked in the middle of a reload.
            return OutputStatus(name=name, to=settings.to, encoding=settings.encoding, state="closed")
        if self._network is None:
            return output.status()
        waited = (stats.lost for stats in self._messages.stats() if stats.name == NETWORK)
        return output.status(self._network.failure(output), never_came=self._network.lost + sum(waited))


def socket_path(settings: Settings, *, name: str, environ: Mapping[str, str]) -> Path | None:
    """Where the local socket is to be, None for nowhere: as [service] says, or below what the host gives."""
    asked = settings.service.socket
    if asked != AUTO:
        return expanded(asked) if asked else None
    # systemd gives several, one behind the other, where the unit asks for several.
    given = environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    if given:
        return Path(given) / f"{name}.sock"
    own = environ.get("XDG_RUNTIME_DIR", "")
    if not own or not Path(own).is_dir():
        return None
    folder = Path(own) / "quavelet"
    folder.mkdir(mode=0o700, exist_ok=True)
    return folder / f"{name}.sock"


def _networked(settings: Settings) -> dict[str, OutputSettings]:
    return {name: output for name, output in settings.output.items() if output.to != STDOUT}


def _of_stdout(name: str, settings: OutputSettings, stats: SubscriberStats | None) -> OutputStatus:
    state = "goes nowhere"
    if stats is not None:
        state = f"failed: {stats.failed}" if stats.failed else "open"
    return OutputStatus(
        name=name,
        to=settings.to,
        encoding=settings.encoding,
        state=state,
        sent=stats.delivered if stats else 0,
        lost=stats.lost if stats else 0,
    )
