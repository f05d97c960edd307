"""GPIO chips to ask for a line: those of the kernel's gpio-sim, and a stand-in for the module gpiod."""

from __future__ import annotations

import errno
import os
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType, SimpleNamespace

from quavelet.core.clock import VirtualClock
from quavelet.core.units import NS_PER_S

CONFIG = Path("/sys/kernel/config/gpio-sim")
LABEL = "quavelet-sim"


@contextmanager
def simulated_chip(*, lines: int = 4) -> Iterator[Path]:
    """A chip of gpio-sim, labelled `LABEL`: the folder of its lines. `pull` in sim_gpioN moves line N."""
    device = CONFIG / "quavelet"
    bank = device / "bank0"
    bank.mkdir(parents=True)
    try:
        (bank / "num_lines").write_text(str(lines))
        (bank / "label").write_text(LABEL)
        (device / "live").write_text("1")
        name = (device / "dev_name").read_text().strip()
        yield Path("/sys/devices/platform") / name / (bank / "chip_name").read_text().strip()
    finally:
        (device / "live").write_text("0")
        bank.rmdir()
        device.rmdir()


class StandIn:
    """What quavelet uses of gpiod 2.1, on chips that are only here.

    chips    by path: label and names of the lines; an errno that opening is refused with
    busy     who has a line, by (label, offset)
    fail     errno of every wait from here on
    clock    who waits moves it on
    """

    def __init__(self) -> None:
        self.chips: dict[str, tuple[str, list[str]] | int] = {}
        self.busy: dict[tuple[str, int], str] = {}
        self.fail: int | None = None
        self.clock = VirtualClock()
        self.open: list[str] = []
        self.requests: list[StandInRequest] = []
        self.settings: list[dict[str, object]] = []

    def module(self) -> ModuleType:
        module = ModuleType("gpiod")
        settings = lambda **asked: self.settings.append(asked) or asked  # noqa: E731
        words = SimpleNamespace(
            Direction=SimpleNamespace(INPUT="input"),
            Edge=SimpleNamespace(RISING="rising"),
            Clock=SimpleNamespace(MONOTONIC="monotonic"),
        )
        vars(module).update(
            Chip=lambda path: StandInChip(self, path), LineSettings=settings, line=words, request_lines=None
        )
        return module

    def pulse(self, t_ns: int) -> None:
        for request in self.requests:
            request.edge(t_ns)


class StandInChip:
    def __init__(self, all_: StandIn, path: str) -> None:
        found = all_.chips[path]
        if isinstance(found, int):
            raise OSError(found, os.strerror(found), path)
        self.all, self.path = all_, path
        self.label, self.names = found
        all_.open.append(path)

    def __enter__(self) -> StandInChip:
        return self

    def __exit__(self, *_: object) -> None:
        self.all.open.remove(self.path)

    def get_info(self) -> SimpleNamespace:
        return SimpleNamespace(label=self.label, num_lines=len(self.names))

    def get_line_info(self, offset: int) -> SimpleNamespace:
        return SimpleNamespace(consumer=self.all.busy.get((self.label, offset), ""))

    def line_offset_from_id(self, line: int | str) -> int:
        if isinstance(line, str):
            if line not in self.names:
                raise FileNotFoundError(errno.ENOENT, "No such file or directory")
            return self.names.index(line)
        if line >= len(self.names):
            raise ValueError("line offset of out range")
        return line

    def request_lines(
        self, config: dict[int, dict[str, object]], *, consumer: str, event_buffer_size: int
    ) -> StandInRequest:
        assert consumer == "quavelet"
        ((offset, settings),) = config.items()
        assert settings == {"direction": "input", "edge_detection": "rising", "event_clock": "monotonic"}
        if (self.label, offset) in self.all.busy:
            raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))
        request = StandInRequest(self.all, event_buffer_size)
        self.all.requests.append(request)
        return request


class StandInRequest:
    """A line as the kernel has it: a queue of edges, of which the oldest go when it is full."""

    def __init__(self, all_: StandIn, size: int) -> None:
        self.all = all_
        self.queue: deque[SimpleNamespace] = deque(maxlen=size)
        self.seq = 0

    def edge(self, t_ns: int) -> None:
        self.seq += 1
        self.queue.append(SimpleNamespace(timestamp_ns=t_ns, line_seqno=self.seq))

    def wait_edge_events(self, timeout: float) -> bool:
        if self.all.fail is not None:
            raise OSError(self.all.fail, os.strerror(self.all.fail))
        if not self.queue:
            self.all.clock.advance_ns(round(timeout * NS_PER_S))
        return bool(self.queue)

    def read_edge_events(self) -> list[SimpleNamespace]:
        # As many as fit libgpiod's buffer; the rest at the next call.
        return [self.queue.popleft() for _ in range(min(64, len(self.queue)))]

    def release(self) -> None:
        self.all.requests.remove(self)
