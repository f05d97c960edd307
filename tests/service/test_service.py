"""The service as an object: driven on a virtual clock, through the fake chip."""

from contextlib import ExitStack
from pathlib import Path

import pytest

from quavelet.core.clock import VirtualClock
from quavelet.core.errors import DeviceMissing
from quavelet.core.units import NS_PER_S
from quavelet.service.service import STDOUT, Service
from quavelet.settings import BusSettings, Settings
from quavelet.sinks.message import Message


class Kept:
    """A sink that keeps what it gets."""

    def __init__(self, most: int = 1 << 30) -> None:
        self.messages: list[Message] = []
        self.closed = False
        self._most = most

    def write(self, message: Message) -> None:
        if len(self.messages) == self._most:
            raise BrokenPipeError
        self.messages.append(message)

    def close(self) -> None:
        self.closed = True


def service_on(bus: str, kept: Kept, *, address: int = 0x68, record: Path | None = None) -> tuple[Service, list[str]]:
    said: list[str] = []

    def console(service: Service, stack: ExitStack) -> None:
        del stack
        service.messages.subscribe(STDOUT, kept, policy=service.policy)

    settings = Settings(bus=BusSettings(name=bus, address=address))
    service = Service(settings, clock=VirtualClock(), talk=said.append, console=console, record=record, realtime=False)
    return service, said


def test_a_run_gives_every_message_and_closes_what_takes_them() -> None:
    kept = Kept()
    service, _ = service_on("fake:tilt", kept)
    service.run(until_ns=3 * NS_PER_S)
    assert service.streamed
    assert 270 <= len(kept.messages) <= 300
    assert kept.closed


def test_a_reader_that_leaves_ends_the_run() -> None:
    kept = Kept(most=20)
    service, _ = service_on("fake:tilt", kept)
    service.run()
    assert isinstance(service.messages.failures()[STDOUT], BrokenPipeError)


def test_a_stop_before_the_chip_is_there_ends_the_run_too() -> None:
    kept = Kept()
    service, _ = service_on("fake:tilt", kept)
    service.stop()
    service.run()
    assert kept.closed and not kept.messages


def test_a_chip_that_never_answers_leaves_no_empty_recording(tmp_path: Path) -> None:
    service, _ = service_on("fake:tilt", Kept(), address=0x69, record=tmp_path / "empty.qrec")
    with pytest.raises(DeviceMissing):
        service.run()
    assert not service.streamed
    assert list(tmp_path.iterdir()) == []
