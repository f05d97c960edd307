"""Every register of the map: reset value, access, and what of a write stays."""

from __future__ import annotations

import pytest

from hw_fakes.chip.registers import REGISTERS

FACTORY = {*range(0x06, 0x0C), *range(0x0D, 0x11)}
FIFO_PORT, POWER, WHO_AM_I = 0x74, 0x6B, 0x75

# RM rev 4.2, section 3: the registers marked R, and those with reserved or self-clearing bits in the middle.
READ_ONLY = {*range(0x35, 0x37), *range(0x3A, 0x61), 0x72, 0x73, 0x75}
WRITABLE = {*range(0x0D, 0x11), 0x19, 0x1C, *range(0x23, 0x35), *range(0x63, 0x68), 0x6C}


def test_table_has_each_of_the_128_addresses_once():
    assert [register.address for register in REGISTERS] == list(range(128))
    names = [register.name for register in REGISTERS if register.name != "reserved"]
    assert len(set(names)) == len(names)
    assert all(name.replace("_", "").isalnum() for name in names)


def test_registers_that_are_not_modelled_are_few():
    assert {r.address for r in REGISTERS if not r.modelled} == {
        *range(6),  # analogue trim
        0x0C,  # PRODUCT_ID, which is there to be read
        *(0x11, 0x12, 0x62, *range(0x76, 0x80)),  # reserved
        *(0x39, 0x70, 0x71),  # the motion processor
    }


def test_table_agrees_with_the_register_map_on_what_can_be_written():
    assert {r.address for r in REGISTERS if r.access == "r"} >= READ_ONLY
    assert {r.address for r in REGISTERS if r.access == "rw" and r.sticks == 0xFF} >= WRITABLE
    assert {r.address: r.reset for r in REGISTERS if r.reset} == {0x00: 0x01, 0x6B: 0x40, 0x75: 0x68}


@pytest.mark.parametrize("register", REGISTERS, ids=lambda r: f"{r.address:02x}")
def test_register_has_its_reset_value_and_keeps_what_the_table_says(board, register):
    address = register.address
    if address not in FACTORY:
        assert board.byte(address) == register.reset
    board.wake(div=255)  # no sample falls before the test is over
    first = board.byte(address)
    for pattern in (0xFF, 0x00, 0xA5, 0x5A):
        if address == POWER:
            pattern &= 0x3F  # neither reset nor sleep
        board.wr(address, pattern)
        kept = first if register.access == "r" else pattern & register.sticks
        assert board.byte(address) == kept
    board.wr(POWER, 0x80)
    board.wait_ms(101)
    if address not in FACTORY:
        assert board.byte(address) == register.reset


@pytest.mark.parametrize("address", sorted(FACTORY))
def test_factory_values_come_back_with_a_reset(board, address):
    factory = board.byte(address)
    board.wake()
    board.wr(address, factory ^ 0xFF)
    assert board.byte(address) == factory ^ 0xFF
    board.wr(POWER, 0x80)
    board.wait_ms(101)
    assert board.byte(address) == factory


@pytest.mark.parametrize("register", [r for r in REGISTERS if not r.modelled], ids=lambda r: f"{r.address:02x}")
def test_register_that_is_not_modelled_changes_nothing(make_board, register):
    def stream(write):
        board = make_board()
        board.wake()
        if write:
            board.bus.write(0x68, bytes([register.address, 0xFF]))
        else:
            board.bus.write(0x68, b"\x19\x00")
        board.start_fifo()
        board.wait_ms(20)
        return board.rd(FIFO_PORT, 280), board.sensors().tolist()

    assert stream(True) == stream(False)
