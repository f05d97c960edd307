"""Boards to check up: a fake chip with what is wrong with it, and the machine it is on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from hw_fakes import NOISE_ONLY, FakeBus, FakeMpu6050
from hw_fakes.faults.plan import parse
from hw_fakes.target import Target
from quavelet.bench.checkup import CheckUp
from quavelet.bench.finding import Finding
from quavelet.bench.host import Host
from quavelet.core.clock import Clock, VirtualClock
from quavelet.core.errors import ImuError
from quavelet.settings import Settings

QUIET: Any = {"imperfections": NOISE_ONLY, "seed": 3}


@dataclass(frozen=True)
class Checked:
    """What a check-up came to."""

    findings: list[Finding]
    error: ImuError | None

    def __getitem__(self, name: str) -> Finding:
        (found,) = [finding for finding in self.findings if finding.name == name]
        return found

    @property
    def names(self) -> list[str]:
        return [finding.name for finding in self.findings]

    @property
    def bad(self) -> list[str]:
        return [finding.name for finding in self.findings if not finding.ok]


def good_chip(clock: Clock) -> FakeMpu6050:
    return FakeMpu6050(clock, **QUIET)


def chip(**arguments: Any) -> Callable[[Clock], FakeMpu6050]:
    """A maker of a chip like the good one but for these."""
    return lambda clock: FakeMpu6050(clock, **{**QUIET, **arguments})


def checked(
    make: Callable[[Clock], Target] | None = good_chip,
    *faults: str,
    at: int = 0x68,
    speed_hz: int = 400_000,
    settings: Settings | None = None,
    host: Host | None = None,
    beside: dict[int, Target] | None = None,
    prepare: Callable[[FakeBus], None] = lambda _bus: None,
) -> Checked:
    """The check-up of a bus with the chip that `make` makes at address `at`, None for no chip, and others `beside`."""
    clock = VirtualClock()
    targets = dict(beside or {})
    if make is not None:
        targets[at] = make(clock)

    def opener(_name: str, /, *, clock: Clock) -> FakeBus:
        bus = FakeBus(targets, clock=clock, name="fake:board", speed_hz=speed_hz)
        for fault in faults:
            bus.adapter.faults.add(parse(fault))
        prepare(bus)
        return bus

    check = CheckUp(settings or Settings(), clock=clock, host=host, opener=opener)
    findings = list(check.findings())
    return Checked(findings, check.error)


class Registers:
    """Another chip: 256 registers and nothing more."""

    def __init__(self, **registers: int) -> None:
        self.bytes = bytearray(256)
        for name, value in registers.items():
            self.bytes[int(name[1:], 16)] = value
        self.at = 0
        self.written: list[bytes] = []

    def write(self, data: bytes) -> None:
        self.at = data[0]
        if len(data) > 1:
            self.written.append(data)

    def read(self, n: int) -> bytes:
        return bytes(self.bytes[(self.at + k) % 256] for k in range(n))

    def stop(self) -> None:
        return


class Clock3231(Registers):
    """A DS3231 at 12:34:56 on a Sunday."""

    def __init__(self) -> None:
        super().__init__(r00=0x56, r01=0x34, r02=0x12, r03=0x07, r04=0x22, r05=0x11, r06=0x26)
