"""The fake's wires as the bus object that quavelet's driver talks to."""

from __future__ import annotations

import errno
from collections.abc import Mapping, Sequence

import numpy as np

from hw_fakes.chip.mpu6050 import FakeMpu6050
from hw_fakes.faults.catalogue import CATALOGUE
from hw_fakes.faults.orders import Orders
from hw_fakes.target import Target
from hw_fakes.wire.adapter import READ, Adapter, Message
from hw_fakes.wire.int_line import FakeDataReady
from quavelet.bus.faults import bus_error
from quavelet.bus.protocol import OfferedFault, OrderedFault
from quavelet.core.blocks import FloatArray, IntArray
from quavelet.core.clock import Clock
from quavelet.core.closing import Closing
from quavelet.core.errors import BusError, SettingsError
from quavelet.core.units import NS_PER_S

INT_LINE = "fake:int"


class FakeBus(Closing):
    """The chips on one bus; implements `I2CBus`, `HasDataReady`, `FailsOnOrder`, `KnowsTruth` of
    `quavelet.bus.protocol`.

    adapter  the wires, with their time, chips and faults
    """

    def __init__(
        self, targets: Mapping[int, Target], *, clock: Clock, name: str = "fake:bus", speed_hz: int = 400_000
    ) -> None:
        self.adapter = Adapter(targets, clock=clock, speed_hz=speed_hz)
        self.clock = clock
        self._name = name
        self._closed = False
        self._orders = Orders(self.adapter.faults, clock=clock)

    @property
    def name(self) -> str:
        return self._name

    @property
    def targets(self) -> dict[int, Target]:
        """The chips by address; one put in or taken out here is put on or off the wires."""
        return self.adapter.targets

    @property
    def busy_ns(self) -> int:
        """The time all transactions took on the wire."""
        return self.adapter.busy_ns

    @property
    def transactions(self) -> int:
        """How many there were, also those that failed."""
        return self.adapter.transfers

    def write(self, address: int, data: bytes) -> None:
        if not data:
            raise ValueError("a write needs at least one byte")
        self._transfer([(address, 0, data)])

    def write_read(self, address: int, data: bytes, n: int) -> bytes:
        if not data or n < 1:
            raise ValueError("a combined read needs at least one byte to write and one to read")
        return self._transfer([(address, 0, data), (address, READ, n)])[1]

    def data_ready(self, name: str, /, *, address: int) -> FakeDataReady:
        """The wire "fake:int" from the INT pin of the chip at `address`. Raises SettingsError for any other."""
        if name != INT_LINE:
            raise SettingsError(f"there is no line '{name}' at a fake bus: write {INT_LINE}")
        chip = self.targets.get(address)
        if not isinstance(chip, FakeMpu6050):
            raise SettingsError(f"there is no MPU-6050 with an INT pin at 0x{address:02x} on {self._name}")
        return FakeDataReady(chip, clock=self.clock, name=name)

    def faults(self) -> Sequence[OfferedFault]:
        return CATALOGUE

    def fail(self, text: str, /) -> int:
        return self._orders.order(text)

    def ordered(self) -> Sequence[OrderedFault]:
        return self._orders.seen

    def attitude(self, t_ns: IntArray, /) -> FloatArray:
        """Of the first MPU-6050 whose motion is known."""
        for chip in self.targets.values():
            if isinstance(chip, FakeMpu6050) and chip.motion is not None:
                return chip.motion.attitude((t_ns - chip.birth_ns) / NS_PER_S)
        return np.full((len(t_ns), 4), np.nan)

    def close(self) -> None:
        self._closed = True

    def _transfer(self, messages: list[Message]) -> list[bytes]:
        address, _, data = messages[0]
        if self._closed:
            raise BusError(f"the bus {self._name} is closed: open it again", errno=errno.EBADF, address=address)
        if self._orders.busy:
            self._orders.take_up()
        try:
            return self.adapter.transfer(messages)
        except OSError as error:
            register = data[0] if isinstance(data, bytes) else None
            raise bus_error(error.errno, bus=self._name, address=address, register=register) from None
        finally:
            if self._orders.busy:
                self._orders.follow()
