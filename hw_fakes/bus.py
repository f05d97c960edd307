"""An I2C bus that takes the time a real one takes."""

from __future__ import annotations

import errno
from collections.abc import Mapping
from types import TracebackType
from typing import Protocol, Self

from hw_fakes.chip import Nack
from quavelet.bus.faults import bus_error
from quavelet.core.clock import Clock, VirtualClock
from quavelet.core.errors import BusError
from quavelet.core.units import NS_PER_S


class Target(Protocol):
    """What sits at an address. Raises `Nack` where it does not acknowledge."""

    def write(self, data: bytes) -> None: ...

    def read(self, n: int) -> bytes: ...

    def stop(self) -> None: ...


class FakeBus:
    """The targets on one bus; implements `quavelet.bus.protocol.I2CBus`.

    On the wire a byte is 9 bit-times, a START, repeated START or STOP one each. The time adds up in `busy_ns`, and a
    virtual clock is moved on by it after the transaction, so that what happens meanwhile is seen by the next one.
    A target that does not answer is errno 121, as a Raspberry Pi tells it.
    """

    def __init__(
        self, targets: Mapping[int, Target], *, clock: Clock, name: str = "fake:bus", speed_hz: int = 400_000
    ) -> None:
        self.targets = dict(targets)
        self.clock = clock
        self.speed_hz = speed_hz
        self.busy_ns = 0
        self.transactions = 0
        self._name = name
        self._closed = False

    @property
    def name(self) -> str:
        return self._name

    def write(self, address: int, data: bytes) -> None:
        if not data:
            raise ValueError("a write needs at least one byte")
        self._transfer(address, data, 0)

    def write_read(self, address: int, data: bytes, n: int) -> bytes:
        if not data or n < 1:
            raise ValueError("a combined read needs at least one byte to write and one to read")
        return self._transfer(address, data, n)

    def close(self) -> None:
        self._closed = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.close()

    def _transfer(self, address: int, data: bytes, n: int) -> bytes:
        if self._closed:
            raise BusError(f"the bus {self._name} is closed: open it again", errno=errno.EBADF, address=address)
        self.transactions += 1
        target = self.targets.get(address)
        bits = 1 + 9 + 1  # START, address, STOP: all there is when nobody answers
        try:
            if target is None:
                raise Nack
            target.write(data)
            bits += 9 * len(data)
            answer = b""
            if n:
                answer = target.read(n)
                bits += 1 + 9 + 9 * n
            return answer
        except Nack:
            raise bus_error(errno.EREMOTEIO, bus=self._name, address=address, register=data[0]) from None
        finally:
            if target is not None:
                target.stop()
            self._take(bits)

    def _take(self, bits: int) -> None:
        wire_ns = -(-bits * NS_PER_S // self.speed_hz)
        self.busy_ns += wire_ns
        if isinstance(self.clock, VirtualClock):
            self.clock.advance_ns(wire_ns)
