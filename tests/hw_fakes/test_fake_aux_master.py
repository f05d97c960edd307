"""The auxiliary master on a register file: what it reads and writes, where it puts it, and what it flags."""

from __future__ import annotations

import pytest
from aux_bench import CHIP, DI, EN, EXT, NOBODY, OTHER, READ, SLV4_CTRL, STATUS, Bench, Memory, Silent
from hypothesis import given, settings
from hypothesis import strategies as st

# What is done


def test_nothing_happens_while_the_master_is_off():
    bench = Bench()
    bench.slave(0, READ | CHIP, 3, EN | 6)
    bench.wr(0x6A, 0x00)
    before = bytes(bench.registers)
    assert not bench.master.active(bench.registers)
    assert not bench.sample()
    assert bytes(bench.registers) == before
    assert bench.master.targets[CHIP].log == []


@pytest.mark.parametrize("control", [0x06, EN])
def test_slave_that_is_off_or_has_no_bytes_is_left_alone(control):
    bench = Bench()
    bench.slave(0, READ | CHIP, 3, control)
    assert not bench.master.active(bench.registers)
    bench.sample()
    assert bench.master.targets[CHIP].log == []


@pytest.mark.parametrize("n", range(4))
def test_slave_reads_from_its_register_into_the_first_external_bytes(n):
    bench = Bench()
    bench.slave(n, READ | CHIP, 0x30, EN | 6)
    assert bench.master.active(bench.registers)
    bench.sample()
    assert bench.ext(7) == bytes([0x30, 0x31, 0x32, 0x33, 0x34, 0x35, 0])
    assert bench.master.targets[CHIP].log == [("write", b"\x30"), ("read", 6), ("stop",)]


def test_register_number_is_not_sent_with_reg_dis():
    bench = Bench()
    bench.slave(0, READ | CHIP, 0x30, EN | 0x20 | 2)
    bench.sample()
    bench.sample()
    assert bench.master.targets[CHIP].log == [("read", 2), ("stop",)] * 2
    assert bench.ext(2) == b"\x02\x03"
    bench.slave(0, CHIP, 0x30, EN | 0x20 | 1, output=0x77)
    bench.sample()
    assert bench.master.targets[CHIP].log[-2:] == [("write", b"\x77"), ("stop",)]


@pytest.mark.parametrize("n", range(4))
def test_slave_writes_its_output_byte_at_each_sample(n):
    bench = Bench()
    bench.slave(n, CHIP, 0x0A, EN | 1, output=0x11 + n)
    for _ in range(3):
        bench.sample()
    assert bench.master.targets[CHIP].log == [("write", bytes([0x0A, 0x11 + n])), ("stop",)] * 3
    assert bench.ext(24) == bytes(24)


def test_slaves_are_served_in_their_order():
    bench = Bench({CHIP: Memory()})
    bench.slave(2, READ | CHIP, 0x20, EN | 1)
    bench.slave(0, CHIP, 0x20, EN | 1, output=0xEE)
    bench.slave_4(READ | CHIP, 0x20)
    bench.sample()
    assert bench.ext(1) == b"\xee"
    assert bench.registers[DI] == 0xEE


# Where it goes


def test_external_bytes_follow_each_other_in_the_order_of_the_slaves():
    bench = Bench()
    bench.slave(2, READ | OTHER, 0, EN | 2)
    bench.slave(0, READ | CHIP, 0x10, EN | 4)
    bench.slave(1, CHIP, 0x80, EN | 1)  # writes, and takes no place
    bench.slave(3, READ | CHIP, 0x40, EN | 1)
    bench.sample()
    assert bench.ext(8) == bytes([0x10, 0x11, 0x12, 0x13, 100, 101, 0x40, 0])


def test_bytes_beyond_the_24th_are_lost_and_no_other_register_is_hit():
    bench = Bench()
    bench.slave(0, READ | CHIP, 0x00, EN | 15)
    bench.slave(1, READ | OTHER, 0x00, EN | 15)
    bench.slave(2, READ | CHIP, 0x50, EN | 15)
    bench.sample()
    assert bench.ext(24) == bytes([*range(15), *range(100, 109)])
    assert bench.registers[EXT + 24 : 0x63] == bytes(0x63 - EXT - 24)


def two_slaves():
    bench = Bench()
    bench.slave(0, READ | CHIP, 0x10, EN | 2)
    bench.slave(1, READ | OTHER, 0, EN | 2)
    bench.sample()
    assert bench.ext(4) == bytes([0x10, 0x11, 100, 101])
    return bench


def test_slave_that_is_disabled_keeps_its_place():
    bench = two_slaves()
    bench.wr(0x27, 0)
    bench.master.targets[OTHER].bytes[0] = 0xAA
    bench.sample()
    assert bench.ext(4) == bytes([0x10, 0x11, 0xAA, 101])


def test_places_are_given_anew_once_all_slaves_are_off():
    bench = two_slaves()
    bench.wr(0x27, 0)
    bench.wr(0x2A, 0)
    bench.wr(0x2A, EN | 2)
    bench.sample()
    assert bench.ext(4) == bytes([100, 101, 100, 101])


def test_places_are_given_anew_with_i2c_mst_reset():
    bench = two_slaves()
    bench.wr(0x27, 0)
    bench.master.reset()
    bench.sample()
    assert bench.ext(4) == bytes([100, 101, 100, 101])


def test_slave_that_joins_comes_after_the_others():
    # The example of RM registers 73 to 96: slave 2, or slave 3 in its stead, begins behind slaves 0 and 1.
    for n in (2, 3):
        bench = two_slaves()
        bench.slave(n, READ | CHIP, 0x60, EN | 1)
        bench.sample()
        assert bench.ext(5) == bytes([0x10, 0x11, 100, 101, 0x60])


@pytest.mark.parametrize(
    ("control", "register", "expected"),
    [
        (0x00, 4, [4, 5, 6, 7, 8]),
        (0x40, 4, [5, 4, 7, 6, 8]),  # words 4 5 and 6 7
        (0x40, 3, [3, 5, 4, 7, 6]),  # words 4 5 and 6 7
        (0x50, 3, [4, 3, 6, 5, 7]),  # words 3 4 and 5 6
        (0x50, 4, [4, 6, 5, 8, 7]),  # words 5 6 and 7 8
        (0x10, 4, [4, 5, 6, 7, 8]),  # grouping without swapping
    ],
)
def test_bytes_are_swapped_within_words_that_begin_at_even_or_odd_registers(control, register, expected):
    bench = Bench()
    bench.slave(0, READ | CHIP, register, EN | control | 5)
    bench.sample()
    assert list(bench.ext(5)) == expected


def test_fifo_gets_the_bytes_of_the_slaves_that_are_asked_for():
    bench = Bench()
    for n, (address, register) in enumerate([(CHIP, 0x10), (OTHER, 0), (CHIP, 0x20), (OTHER, 7)]):
        bench.slave(n, READ | address, register, EN | 2)
    bench.sample()
    parts = [b"\x10\x11", b"\x64\x65", b"\x20\x21", b"\x6b\x6c"]
    for mask in range(16):
        bench.wr(0x23, 0xF8 | mask & 7)
        bench.wr(0x24, 0x20 if mask & 8 else 0)
        asked = b"".join(part for n, part in enumerate(parts) if mask & 1 << n)
        assert bench.master.fifo_bytes(bench.registers) == asked
    bench.wr(0x6A, 0x00)
    assert bench.master.fifo_bytes(bench.registers) == b""


# When and with what flags


def test_slave_with_its_delay_bit_is_served_every_few_samples():
    bench = Bench()
    bench.slave(0, READ | CHIP, 0, EN | 1)
    bench.slave(1, READ | OTHER, 0, EN | 1)
    bench.wr(SLV4_CTRL, 4)
    bench.wr(0x67, 0x02)
    for _ in range(20):
        bench.sample()
    assert bench.master.targets[CHIP].log.count(("stop",)) == 20
    assert bench.master.targets[OTHER].log.count(("stop",)) == 4
    assert bench.master.active(bench.registers)


def test_slave_4_with_its_delay_bit_waits_for_its_turn():
    bench = Bench()
    bench.wr(0x67, 0x10)
    bench.sample()
    bench.slave_4(READ | CHIP, 0x42, control=EN | 3)
    for _ in range(3):
        bench.sample()
        assert bench.registers[STATUS] == 0
    bench.sample()
    assert bench.registers[STATUS] == 0x40


@pytest.mark.parametrize("n", range(4))
@pytest.mark.parametrize("address", [NOBODY, CHIP])
@pytest.mark.parametrize("direction", [0, READ])
def test_slave_that_does_not_answer_is_flagged_and_its_bytes_stay(n, address, direction):
    bench = Bench()
    bench.slave(n, READ | CHIP, 0x10, EN | 2)
    assert not bench.sample()
    assert bench.registers[STATUS] == 0
    bench.master.targets[CHIP] = Silent()
    bench.wr(0x25 + 3 * n, direction | address)
    assert bench.sample()
    assert bench.registers[STATUS] == 1 << n
    assert bench.ext(3) == b"\x10\x11\x00"


def test_slave_after_one_that_does_not_answer_is_still_served_at_its_place():
    bench = Bench()
    bench.slave(0, READ | NOBODY, 0, EN | 3)
    bench.slave(1, READ | OTHER, 0, EN | 2)
    bench.sample()
    assert bench.ext(6) == bytes([0, 0, 0, 100, 101, 0])


def test_slave_4_reads_one_byte_once():
    bench = Bench()
    bench.slave_4(READ | CHIP, 0x42, control=EN | 0x03)
    assert bench.master.active(bench.registers)
    assert not bench.sample()
    assert bench.registers[DI] == 0x42
    assert bench.registers[STATUS] == 0x40
    assert bench.registers[SLV4_CTRL] == 0x03
    assert not bench.master.active(bench.registers)
    bench.sample()
    assert bench.master.targets[CHIP].log.count(("stop",)) == 1
    assert bench.ext(24) == bytes(24)


def test_slave_4_writes_one_byte_once_and_can_interrupt():
    bench = Bench()
    bench.slave_4(CHIP, 0x0B, output=0x99, control=EN | 0x40)
    assert bench.sample()
    assert bench.master.targets[CHIP].log == [("write", b"\x0b\x99"), ("stop",)]
    assert bench.registers[STATUS] == 0x40
    assert bench.registers[DI] == 0
    assert not bench.sample()


def test_slave_4_that_is_not_acknowledged_is_done_all_the_same():
    bench = Bench()
    bench.slave_4(READ | NOBODY, 0)
    assert bench.sample()
    assert bench.registers[STATUS] == 0x40 | 0x10
    assert bench.registers[SLV4_CTRL] == 0


def test_status_bits_stay_until_they_are_cleared():
    bench = Bench()
    bench.slave(1, READ | NOBODY, 0, EN | 1)
    bench.sample()
    bench.wr(0x26 + 3, 0)
    bench.wr(0x25 + 3, READ | CHIP)
    assert not bench.sample()
    assert bench.registers[STATUS] == 0x02


# Always


@settings(max_examples=300, deadline=None)
@given(
    aux=st.binary(min_size=0x12, max_size=0x12),
    outputs=st.binary(min_size=5, max_size=5),
    addresses=st.lists(st.sampled_from([0x0C, 0x8C, 0x1E, 0x9E, 0x55, 0xD5]), min_size=5, max_size=5),
    user_ctrl=st.sampled_from([0x00, 0x20, 0x60]),
    fifo_en=st.integers(0, 255),
    samples=st.integers(1, 9),
)
def test_no_configuration_raises_or_hits_another_register(aux, outputs, addresses, user_ctrl, fifo_en, samples):
    bench = Bench({CHIP: Memory(7), OTHER: Silent()})
    registers = bench.registers
    registers[0x24:0x36] = aux
    for n, address in enumerate(addresses):
        registers[0x25 + 3 * n] = address
    registers[0x63:0x68] = outputs
    registers[0x6A], registers[0x23] = user_ctrl, fifo_en
    before = bytes(registers)
    for number in range(samples):
        interrupt = bench.master.sample(registers, number, number * 1_000_000)
        assert isinstance(interrupt, bool)
        assert len(bench.master.fifo_bytes(registers)) <= 24
    assert bench.master.delay_ns(registers) >= 0
    allowed = {DI, STATUS, *range(EXT, EXT + 24)}
    changed = {register for register in range(128) if registers[register] != before[register]}
    assert changed <= allowed | {SLV4_CTRL}
    assert registers[SLV4_CTRL] in (before[SLV4_CTRL], before[SLV4_CTRL] & 0x7F)
    assert registers[STATUS] & 0xA0 == before[STATUS] & 0xA0
    if not user_ctrl & 0x20:
        assert not changed
