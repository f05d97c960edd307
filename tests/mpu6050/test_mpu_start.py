"""The start-up: what goes over the bus, in which order, and when."""

from __future__ import annotations

from itertools import pairwise

import pytest
from chip_rig import ADDRESS, Rig, StubbornChip, Transfer, config

from hw_fakes import FakeBus, FakeMpu6050, ScriptedBus, Write, WriteRead
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import BusError, ChipUnstable, DeviceMissing, WrongChip
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050.registers import REGISTERS
from quavelet.mpu6050.source import ChipSource, Step

CONFIGURATION = {0x6C, 0x1A, 0x1B, 0x1C, 0x19, 0x23, 0x37, 0x38}


def read(register: int, answer: str) -> WriteRead:
    return WriteRead(ADDRESS, bytes([register]), bytes.fromhex(answer))


def write(register: int, byte: int) -> Write:
    return Write(ADDRESS, bytes([register, byte]))


def change(register: int, before: int, after: int) -> list[Write | WriteRead]:
    return [read(register, f"{before:02x}"), write(register, after)]


HELD = [
    read(register, answer)
    for register, answer in zip(
        [0x6B, 0x6C, 0x1A, 0x1B, 0x1C, 0x19, 0x6A, 0x23, 0x37, 0x38],
        ["01", "00", "03", "08", "08", "04", "00", "00", "ee", "10"],
        strict=True,
    )
]
START_UP: list[Write | WriteRead] = [
    read(0x75, "68"),
    write(0x6B, 0x80),
    read(0x75, "68"),
    read(0x6B, "40"),
    write(0x6B, 0x01),
    *change(0x6B, 0x01, 0x01),
    *change(0x6C, 0x3F, 0x00),
    *change(0x1A, 0x3F, 0x03),
    *change(0x1B, 0xF8, 0x08),
    *change(0x1C, 0xFF, 0x08),
    *change(0x19, 0x00, 0x04),
    *change(0x6A, 0x20, 0x00),
    *change(0x23, 0xFF, 0x00),
    *change(0x37, 0xFE, 0xEE),  # the pin's own settings stay
    *change(0x38, 0x01, 0x10),
    *HELD,
    *HELD,
    read(0x75, "68"),
    read(0x1A, "03"),
    read(0x1B, "08"),
    read(0x1C, "08"),
    read(0x19, "04"),
    read(0x06, "f7 cc 03 21 04 b0 00"),  # the revision: on one bit hangs a factor of two
    read(0x06, "f7 cc 03 21 04 b0 00"),
    write(0x23, 0x00),
    write(0x6A, 0x00),
    write(0x6A, 0x04),
    write(0x6A, 0x40),
    read(0x3A, "01"),
    write(0x23, 0xF8),
]
FIRST_DRAIN = [read(0x3A, "01"), read(0x72, "00 46"), read(0x74, bytes(range(14)).hex() * 5)]


def test_start_up_is_these_transactions_and_no_others():
    clock = VirtualClock()
    with ScriptedBus([*START_UP, *FIRST_DRAIN]) as bus:
        source = ChipSource(bus, address=ADDRESS, config=config(), clock=clock, health=Health())
        source.wait_until_streaming()
        clock.advance_ns(10 * NS_PER_MS)
        assert len(source.read()) == 5


def test_stranger_at_the_address_is_never_written_to():
    """At 0x68 there is a DS3231 clock on many boards: a write would set its time."""
    with ScriptedBus([read(0x75, "25")] * 2) as bus:
        source = ChipSource(bus, address=ADDRESS, config=config(), clock=VirtualClock(), health=Health())
        with pytest.raises(WrongChip) as caught:
            source.wait_until_streaming()
    assert caught.value.found == 0x25
    assert set(caught.value.known) == {0x68, 0x69, 0x70, 0x71, 0x72, 0x73, 0x74, 0x75, 0x98}


def test_line_that_reads_otherwise_each_time_is_asked_for_ever():
    clock = VirtualClock()
    with ScriptedBus([read(0x75, f"{byte:02x}") for _ in range(101) for byte in (0x25, 0x19)]) as bus:
        source = ChipSource(bus, address=ADDRESS, config=config(), clock=clock, health=Health())
        with pytest.raises(ChipUnstable, match="otherwise each time"):
            source.wait_until_streaming()
    assert clock.now_ns() < 2 * NS_PER_S


@pytest.mark.parametrize(
    ("value", "meaning"),
    [(0x00, "held low"), (0xFF, "pull-ups"), (0x19, "MPU-6886"), (0x55, "no chip of this family")],
)
def test_wrong_chip_says_the_value_and_what_it_means(value, meaning):
    rig = Rig()
    rig.chip.registers[0x75] = value
    with pytest.raises(WrongChip, match=rf"0x{value:02x}.*{meaning}") as caught:
        rig.start()
    assert caught.value.found == value
    assert rig.chip.written == []


def test_waits_are_those_of_the_data_sheet_and_the_whole_is_under_300_ms():
    rig = Rig()
    begin_ns = rig.clock.now_ns()
    rig.start()
    assert rig.clock.now_ns() - begin_ns < 300 * NS_PER_MS

    def first(register: int, byte: int | None = None, after_ns: int = 0) -> int:
        return next(
            t.at_ns
            for t in rig.bus.trace
            if t.at_ns > after_ns
            and t.register == register
            and (t.is_read if byte is None else t.written == bytes([byte]))
        )

    reset_ns = first(0x6B, 0x80)
    back_ns = first(0x75, after_ns=reset_ns)
    wake_ns = first(0x6B, 0x01)
    configured_ns = min(t.at_ns for t in rig.bus.trace if t.written and t.register in CONFIGURATION)
    fifo_ns = first(0x6A, 0x40)
    assert rig.bus.trace[0].register == 0x75 and rig.bus.trace[0].is_read
    assert back_ns - reset_ns >= 100 * NS_PER_MS
    assert back_ns < wake_ns
    assert configured_ns - wake_ns >= 10 * NS_PER_MS  # the PLL settles
    assert fifo_ns - wake_ns >= 60 * NS_PER_MS  # the gyroscope's zero settles


def test_fifo_is_reset_while_off_and_the_sensors_are_let_in_last():
    rig = Rig().start()
    assert rig.chip.written[-5:] == [(0x23, 0), (0x6A, 0), (0x6A, 4), (0x6A, 0x40), (0x23, 0xF8)]


def test_what_was_in_the_fifo_before_the_start_is_not_given_out():
    rig = Rig()
    for register, byte in ((0x6B, 1), (0x6A, 0x40), (0x23, 0x78)):
        rig.wr(register, byte)
    rig.wait_ms(30)
    rig.start()
    rig.run(0.5)
    check = rig.numbers
    assert len(check) > 90
    assert (check[1:] - check[:-1] == 1).all()


def test_read_never_sleeps_and_is_empty_until_streaming():
    rig = Rig()
    for _ in range(400):
        before_ns, busy_ns = rig.clock.now_ns(), rig.fake_bus.busy_ns
        rows = len(rig.drain())
        assert rig.clock.now_ns() - before_ns == rig.fake_bus.busy_ns - busy_ns
        assert rows == 0 or rig.source.step is Step.STREAM
        rig.wait_ms(1)
    assert rig.source.step is Step.STREAM
    assert len(rig.got) > 20


def test_read_before_a_step_is_due_leaves_the_bus_alone():
    rig = Rig()
    rig.source.read()
    transfers = len(rig.bus.trace)
    rig.clock.sleep_until_ns(rig.source.due_ns - 1)
    rig.source.read()
    assert len(rig.bus.trace) == transfers
    rig.wait_ms(0.001)
    rig.source.read()
    assert len(rig.bus.trace) > transfers


def test_start_up_by_read_and_by_sleeping_give_the_same_chip():
    slept = Rig().start()
    polled = Rig()
    while polled.source.step is not Step.STREAM:
        polled.drain(1)
    assert slept.source.info == polled.source.info
    assert slept.chip.written == polled.chip.written


def test_chip_at_the_other_address_is_driven_there():
    clock = VirtualClock()
    other, chip = FakeMpu6050(clock), FakeMpu6050(clock)
    bus = FakeBus({0x68: other, 0x69: chip}, clock=clock)
    source = ChipSource(bus, address=0x69, config=config(), clock=clock, health=Health())
    assert source.wait_until_streaming().address == 0x69
    clock.advance_ns(50 * NS_PER_MS)
    assert len(source.read()) in (10, 11)
    assert other.written == []


def test_nobody_at_the_address_is_told_at_once():
    rig = Rig()
    rig.chip.unplug()
    begin_ns = rig.clock.now_ns()
    with pytest.raises(DeviceMissing, match="0x68"):
        rig.source.read()
    assert rig.clock.now_ns() - begin_ns < NS_PER_MS
    rig.chip.plug()
    rig.start()  # the same source can be asked again


def test_chip_that_is_silent_during_its_reset_is_waited_for():
    rig = Rig(nack_in_reset=True).start()
    rig.run(0.2)
    assert len(rig.got) > 30


class SlowChip(StubbornChip):
    """A chip whose reset takes longer than the data sheet's 100 ms; meanwhile every register reads `meanwhile`."""

    extra_ns = 300 * NS_PER_MS
    meanwhile: int | None = None

    def _store(self, register: int, value: int) -> None:
        super()._store(register, value)
        if register == 0x6B and value & 0x80:
            self._reset_done_ns += self.extra_ns

    def _load(self, register: int) -> int:
        if self._resetting and self.meanwhile is not None:
            return self.meanwhile
        return super()._load(register)


@pytest.mark.parametrize("meanwhile", [None, 0x00, 0xFF])
def test_chip_that_is_slow_to_leave_reset_is_asked_every_10_ms(meanwhile):
    rig = Rig(chip_type=SlowChip)
    rig.chip.meanwhile = meanwhile
    rig.start()
    asked = [t.at_ns for t in rig.bus.trace if t.register == 0x75][1:]
    waits_ms = [(b - a) / NS_PER_MS for a, b in pairwise(asked)][:20]
    assert waits_ms == pytest.approx([10] * 20, abs=1)
    assert [byte for register, byte in rig.chip.written if register == 0x6B].count(0x80) == 1


def test_chip_that_comes_out_of_reset_awake_is_no_surprise():
    """SLEEP after reset goes by the part's own programming."""
    rig = Rig()
    asked: list[bytes] = []

    def awake(_k: int, transfer: Transfer, answer: bytes) -> bytes:
        if transfer.register != 0x6B or not transfer.is_read:
            return answer
        asked.append(answer)
        return b"\x00" if len(asked) == 1 else answer

    rig.bus.alter = awake
    rig.start()
    assert asked[0] == b"\x40"
    assert rig.health.chip_restarts == 0
    assert len(asked) == 4  # after the reset, and writing the configuration and checking it twice


def test_chip_that_never_leaves_reset_is_reset_each_second_and_called_unstable_after_five():
    rig = Rig(chip_type=SlowChip)
    rig.chip.extra_ns = 3600 * NS_PER_S
    begin_ns = rig.clock.now_ns()
    with pytest.raises(ChipUnstable, match=r"5 tries.*reset.*PWR_MGMT_1 reads 0x"):
        rig.start()
    resets = [t.at_ns for t in rig.bus.trace if t.register == 0x6B and t.written == b"\x80"]
    assert len(resets) == 5
    assert [b - a for a, b in pairwise(resets)] == pytest.approx([NS_PER_S] * 4, rel=0.02)
    assert rig.clock.now_ns() - begin_ns == pytest.approx(5 * NS_PER_S, rel=0.02)
    assert rig.health.chip_restarts == 4


def test_reset_that_finds_no_answer_ends_in_an_error_not_in_an_endless_start():
    """A board unplugged between the first question and the reset."""
    rig = Rig()
    rig.bus.spoil = lambda _k, t: t.register == 0x6B
    begin_ns = rig.clock.now_ns()
    with pytest.raises((BusError, ChipUnstable)):
        while rig.clock.now_ns() - begin_ns < 60 * NS_PER_S:
            rig.drain(10)
    assert rig.clock.now_ns() - begin_ns == pytest.approx(5 * NS_PER_S, rel=0.05)
    assert rig.health.bus_errors > 100


def test_reset_whose_answer_is_lost_once_is_written_again():
    rig = Rig()
    rig.bus.spoil = lambda k, _t: k == 1
    rig.bus.late = True
    rig.start()
    rig.run(0.2)
    assert len(rig.got) > 30
    assert rig.health.bus_errors == 1


@pytest.mark.parametrize("register", sorted(CONFIGURATION - {0x23, 0x6C, 0x37}))
def test_configuration_write_that_gets_lost_once_is_written_again_after_100_ms(register):
    rig = Rig(chip_type=StubbornChip)
    seen: list[int] = []

    def lose_first(at: int, byte: int) -> int | None:
        if at != register:
            return byte
        seen.append(byte)
        return None if len(seen) == 1 else byte

    rig.chip.stubborn = lose_first
    rig.start()
    writes = [t.at_ns for t in rig.bus.trace if t.register == register and t.written]
    assert writes[1] - writes[0] == pytest.approx(100 * NS_PER_MS, rel=0.05)
    assert rig.health.config_mismatches == 1
    assert rig.health.chip_restarts == 0
    assert rig.source.info is not None and rig.source.info.smplrt_div == 4


@pytest.mark.parametrize(
    ("register", "forced"), [(0x1B, 0x18), (0x1C, 0x10), (0x1A, 0x18), (0x6C, 0x04), (0x37, 0x10), (0x6B, 0x08)]
)
def test_register_that_does_not_hold_is_tried_for_five_resets_and_then_named(register, forced):
    rig = Rig(chip_type=StubbornChip)
    rig.chip.stubborn = lambda at, byte: byte | forced if at == register and not byte & 0x80 else byte
    name = next(r.name for r in REGISTERS if r.address == register)
    begin_ns = rig.clock.now_ns()
    with pytest.raises(ChipUnstable, match=rf"5 tries.*{name} did not read back"):
        rig.start()
    assert [byte for at, byte in rig.chip.written if at == 0x6B].count(0x80) == 5
    assert rig.health.chip_restarts == 4
    assert rig.health.config_mismatches >= 5 * 8  # every 100 ms of five seconds, less the resets
    assert rig.clock.now_ns() - begin_ns == pytest.approx(5 * NS_PER_S, rel=0.1)


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("k", range(1, 48))
def test_one_failed_transfer_anywhere_in_the_start_is_survived(k, late):
    rig = Rig()
    rig.bus.spoil = lambda at, _t: at == k
    rig.bus.late = late
    rig.start()
    rig.run(0.2)
    assert (rig.numbers[1:] - rig.numbers[:-1] == 1).all()
    assert len(rig.got) >= 30
    assert rig.health.bus_errors == 1
    assert rig.source.info is not None
    assert (rig.source.info.config, rig.source.info.gyro_config, rig.source.info.smplrt_div) == (3, 8, 4)
