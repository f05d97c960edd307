"""Every failure the operating system tells becomes one error that says where it was and what to do."""

from __future__ import annotations

import errno
import os

import pytest

from quavelet.bus.faults import bus_error
from quavelet.core.errors import BusBusy, BusError, BusPermission, DeviceMissing, ImuError

# number, class, what the sentence must say to help
TABLE = [
    (121, DeviceMissing, ["power", "SDA", "SCL", "AD0"]),  # EREMOTEIO
    (6, DeviceMissing, ["power", "SDA", "SCL", "AD0"]),  # ENXIO
    (16, BusBusy, ["kernel driver", "overlay", "0x69"]),  # EBUSY
    (13, BusPermission, ["group i2c", "usermod", "log in again"]),  # EACCES
    (1, BusPermission, ["group i2c", "usermod", "log in again"]),  # EPERM
    (2, DeviceMissing, ["no bus", "raspi-config", "--bus"]),  # ENOENT
    (19, DeviceMissing, ["no bus", "raspi-config", "--bus"]),  # ENODEV
    (110, BusError, ["timed out", "held low", "pull-ups"]),  # ETIMEDOUT
    (5, BusError, ["EIO", "wires", "pull-ups"]),  # EIO
    (71, BusError, ["EPROTO", "wiring"]),  # not in the table
    (4242, BusError, ["4242", "wiring"]),  # unknown to Linux itself
    (None, BusError, ["no error number", "wiring"]),
]


@pytest.mark.parametrize(("number", "kind", "hints"), TABLE)
def test_every_error_number_has_its_class_and_says_what_to_do(
    number: int | None, kind: type[BusError], hints: list[str]
) -> None:
    error = bus_error(number, bus="linux:1", address=0x68, register=0x3B, attempts=3)
    assert type(error) is kind
    assert (error.errno, error.address, error.register, error.attempts) == (number, 0x68, 0x3B, 3)
    for hint in ["linux:1", *hints]:
        assert hint in str(error)


@pytest.mark.parametrize("number", [row[0] for row in TABLE if row[0] not in (errno.ENOENT, errno.ENODEV)])
def test_the_sentence_of_a_failed_transfer_names_the_address(number: int | None) -> None:
    assert "address 0x6a on linux:7" in str(bus_error(number, bus="linux:7", address=0x6A))


def test_a_bus_that_vanished_is_missed_itself_and_not_an_address_on_it() -> None:
    assert str(bus_error(errno.ENODEV, bus="linux:7", address=0x68)).startswith("there is no bus linux:7:")


@pytest.mark.parametrize("number", [row[0] for row in TABLE])
def test_while_opening_there_is_no_address_to_name(number: int | None) -> None:
    error = bus_error(number, bus="/dev/i2c-1")
    assert "/dev/i2c-1" in str(error)
    assert (error.address, error.register) == (None, None)
    assert "None" not in str(error)
    assert "address 0x" not in str(error)


@pytest.mark.parametrize("number", sorted(errno.errorcode))
def test_no_error_number_at_all_leaves_the_family(number: int) -> None:
    with pytest.raises(ImuError) as caught:
        raise bus_error(number, bus="linux:1", address=0x68)
    assert isinstance(caught.value, OSError)
    assert caught.value.errno == number
    assert "{" not in str(caught.value)


def test_the_numbers_of_the_table_are_those_of_this_system() -> None:
    names = ["EREMOTEIO", "ENXIO", "EBUSY", "EACCES", "EPERM", "ENOENT", "ENODEV", "ETIMEDOUT", "EIO"]
    assert [getattr(errno, name) for name in names] == [row[0] for row in TABLE[: len(names)]]
    assert os.strerror(121) == "Remote I/O error"
