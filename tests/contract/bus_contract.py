"""What every `quavelet.bus.protocol.I2CBus` does, whatever is behind it."""

from __future__ import annotations

import errno
from collections.abc import Callable

import pytest

from quavelet.bus.protocol import I2CBus
from quavelet.core.errors import BusError, DeviceMissing

HERE, NOBODY = 0x68, 0x69
PWR_MGMT_1, SMPLRT_DIV, USER_CTRL, FIFO_R_W, WHO_AM_I = 0x6B, 0x19, 0x6A, 0x74, 0x75

Transfer = Callable[[I2CBus, int, int], object]
Counter = Callable[[], int]


def write(bus: I2CBus, address: int, register: int) -> None:
    bus.write(address, bytes([register, 0x01]))


def write_read(bus: I2CBus, address: int, register: int) -> None:
    bus.write_read(address, bytes([register]), 1)


class BusContract:
    """What a subclass gives:

    NAME          what the bus is opened by
    bus           fixture: the bus, open, with an MPU-6050 just powered up at 0x68 and nobody at 0x69
    transactions  fixture: a function that says how many transactions there were on the wire so far
    """

    NAME: str

    def test_its_name_is_what_it_was_opened_by(self, bus: I2CBus) -> None:
        assert bus.name == self.NAME

    def test_what_is_written_is_read_back(self, bus: I2CBus) -> None:
        bus.write(HERE, bytes([PWR_MGMT_1, 0x01]))
        bus.write(HERE, bytes([SMPLRT_DIV, 0x07, 0x03]))
        assert bus.write_read(HERE, bytes([SMPLRT_DIV]), 2) == b"\x07\x03"
        assert bus.write_read(HERE, bytes([WHO_AM_I]), 1) == b"\x68"

    @pytest.mark.parametrize("n", [1, 2, 31, 32, 33, 255, 256, 257, 1024])
    def test_a_read_of_any_length_is_one_transaction_and_no_byte_short(
        self, bus: I2CBus, transactions: Counter, n: int
    ) -> None:
        sent = bytes(k * 89 % 251 for k in range(n))
        bus.write(HERE, bytes([PWR_MGMT_1, 0x01]))
        bus.write(HERE, bytes([USER_CTRL, 0x40]))
        before = transactions()
        bus.write(HERE, bytes([FIFO_R_W]) + sent)
        got = bus.write_read(HERE, bytes([FIFO_R_W]), n)
        assert type(got) is bytes
        assert got == sent
        assert transactions() - before == 2

    @pytest.mark.parametrize("transfer", [write, write_read])
    @pytest.mark.parametrize("register", [PWR_MGMT_1, 0x00, 0xFF])
    def test_nobody_at_the_address_says_which_address_and_register(
        self, bus: I2CBus, transfer: Transfer, register: int
    ) -> None:
        with pytest.raises(DeviceMissing) as caught:
            transfer(bus, NOBODY, register)
        assert caught.value.errno in (errno.EREMOTEIO, errno.ENXIO)
        assert (caught.value.address, caught.value.register, caught.value.attempts) == (NOBODY, register, 1)
        for hint in ("0x69", self.NAME, "power", "AD0"):
            assert hint in str(caught.value)

    def test_a_failed_transfer_does_not_spoil_the_next(self, bus: I2CBus) -> None:
        for _ in range(3):
            with pytest.raises(DeviceMissing):
                bus.write_read(NOBODY, bytes([WHO_AM_I]), 1)
            assert bus.write_read(HERE, bytes([WHO_AM_I]), 1) == b"\x68"

    @pytest.mark.parametrize("transfer", [write, write_read])
    def test_a_closed_bus_refuses_and_may_be_closed_again(self, bus: I2CBus, transfer: Transfer) -> None:
        bus.close()
        bus.close()
        for address in (HERE, NOBODY):
            with pytest.raises(BusError, match=f"{self.NAME} is closed: open it again") as caught:
                transfer(bus, address, PWR_MGMT_1)
            assert not isinstance(caught.value, DeviceMissing)
            assert (caught.value.errno, caught.value.address) == (errno.EBADF, address)
        assert bus.name == self.NAME

    def test_leaving_the_with_block_closes(self, bus: I2CBus) -> None:
        with bus as inside:
            assert inside is bus
            inside.write_read(HERE, bytes([WHO_AM_I]), 1)
        with pytest.raises(BusError, match="closed"):
            bus.write_read(HERE, bytes([WHO_AM_I]), 1)

    def test_an_error_leaves_the_with_block_as_it_is_and_closes(self, bus: I2CBus) -> None:
        with pytest.raises(KeyError, match="mine"), bus:
            raise KeyError("mine")
        with pytest.raises(BusError, match="closed"):
            bus.write(HERE, bytes([PWR_MGMT_1, 0x01]))

    @pytest.mark.parametrize(("data", "n"), [(b"", 1), (b"\x75", 0), (b"\x75", -1)])
    def test_a_transfer_of_nothing_is_a_mistake_of_the_caller(
        self, bus: I2CBus, transactions: Counter, data: bytes, n: int
    ) -> None:
        before = transactions()
        with pytest.raises(ValueError, match="at least one byte"):
            bus.write_read(HERE, data, n)
        with pytest.raises(ValueError, match="at least one byte"):
            bus.write(HERE, b"")
        assert transactions() == before
