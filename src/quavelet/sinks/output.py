"""One output: what is left out, how the rest is written, where it goes, and what became of it."""

from __future__ import annotations

from quavelet.sinks.encoding import Encoding
from quavelet.sinks.message import Message
from quavelet.sinks.plan import OutputPlan
from quavelet.sinks.status import OutputStatus
from quavelet.sinks.thinning import KEEP_ALIVE_S, Thinning
from quavelet.sinks.transport import Transport


class Output:
    """A part of the network; see `Part`."""

    def __init__(self, plan: OutputPlan, encoding: Encoding, transport: Transport) -> None:
        self.name = f"output.{plan.name}"
        self._plan = plan
        self._encoding = encoding
        self._transport = transport
        self._thinning = thinning_of(plan)
        self._sent = 0

    async def open(self) -> None:
        await self._transport.open()

    def write(self, message: Message) -> bool:
        """Whether anything went out."""
        taken = self._thinning.take(message)
        payload = b"" if taken is None else self._encoding.encode(taken)
        if not payload:
            return False
        self._transport.send(payload)
        before, self._sent = self._sent, self._transport.stats().sent
        return self._sent > before

    async def close(self) -> None:
        await self._transport.close()

    def status(self, failure: str = "", *, never_came: int = 0) -> OutputStatus:
        """What became of its messages; `failure` is why it has ended, "" while it has not, and `never_came` how many
        were lost before any output saw them."""
        settings, stats = self._plan.settings, self._transport.stats()
        return OutputStatus(
            name=self._plan.name,
            to=settings.to,
            encoding=settings.encoding,
            state=f"failed: {failure}" if failure else stats.state,
            sent=stats.sent,
            lost=stats.lost + never_came,
            left_out=self._thinning.left_out,
            readers=stats.readers,
            refused=stats.refused,
            bytes=stats.bytes,
        )


def thinning_of(plan: OutputPlan) -> Thinning:
    """What the output leaves out; a broker is told in time that its values are still good."""
    settings = plan.settings
    keep_alive_s = settings.mqtt.expire_after_s / 2 if settings.is_mqtt else KEEP_ALIVE_S
    return Thinning(rate_hz=settings.rate_hz, dead_band_deg=settings.dead_band_deg, keep_alive_s=keep_alive_s)
