"""The auxiliary bus as part of the chip: external data in the registers and in the FIFO, its interrupt, the bypass."""

from __future__ import annotations

import numpy as np
import pytest
from aux_bench import CHIP, EN, EXT, NOBODY, OTHER, READ, STATUS, Memory

from hw_fakes import PERFECT, TYPICAL, FakeBus, FakeMpu6050, Turntable, boards
from hw_fakes.chip.aux_master import AuxMaster, SettableClock
from hw_fakes.chip.personalities import MPU6500
from quavelet.core.clock import VirtualClock

MASTER_INT, DATA_READY = 0x08, 0x01


class Stamp:
    """A chip whose bytes are the time of its own clock in us, big-endian: whoever reads it says when."""

    def __init__(self, clock):
        self.clock = clock
        self.times_ns = []

    def write(self, _data):
        return

    def read(self, n):
        self.times_ns.append(self.clock.now_ns())
        return (self.clock.now_ns() // 1000).to_bytes(8, "big")[-n:]

    def stop(self):
        return


@pytest.fixture
def make_aux_board(make_board):
    """A board whose chip has a `Stamp` and a `Memory` on its auxiliary bus."""

    def made(**chip):
        clock = VirtualClock()
        aux_clock = SettableClock(clock)
        stamp = Stamp(aux_clock)
        master = AuxMaster({CHIP: stamp, OTHER: Memory()}, clock=aux_clock)

        def open_bus(given):
            how = {"imperfections": PERFECT, "pll_error": 0.0, "internal_error": 0.0, **chip}
            aux_clock.outer = given
            return FakeBus({0x68: FakeMpu6050(given, aux=master, **how)}, clock=given)

        board = make_board(open_bus=open_bus)
        board.stamp = stamp
        return board

    return made


def slave(board, n, address, register=0, control=EN | 6):
    board.wr(0x25 + 3 * n, address, register, control)


def master_on(board, *, fifo=0x00, div=0, dlpf=1):
    board.wake(dlpf=dlpf, div=div)
    slave(board, 0, READ | CHIP)
    board.wr(0x23, fifo)
    board.wr(0x6A, 0x04)
    board.wr(0x6A, 0x20 | (0x40 if fifo else 0))
    return board


def stamps_us(data, frame, words):
    rows = np.frombuffer(data, dtype=np.uint8).reshape(-1, frame)
    return [int.from_bytes(bytes(row[words : words + 6]), "big") for row in rows]


@pytest.mark.parametrize("step_ms", [1.0, 7.3, 20.0])
@pytest.mark.parametrize(("fifo", "words"), [(0xF9, 14), (0x79, 12), (0x01, 0), (0x11, 2)])
def test_external_bytes_are_last_in_a_frame_and_of_its_own_instant(make_aux_board, step_ms, fifo, words):
    board = master_on(make_aux_board(pll_error=0.01), fifo=fifo)
    run, before = board.chip.run, board.chip.samples_taken
    board.wait_ms(3)
    for _ in range(3):
        board.wait_ms(step_ms)
        count = board.fifo_count()
        assert count % (words + 6) == 0
        seen = stamps_us(board.rd(0x74, count), words + 6, words)
        assert np.diff(seen) == pytest.approx(1000 / 1.01, abs=1)
        ticks = [(us * 1000 + 999 - run.start_ns) / run.period_ns for us in seen]
        assert ticks == pytest.approx(np.round(ticks), abs=2e-3)
    assert board.chip.samples_taken > before


def test_fifo_with_external_bytes_overflows_at_the_size_and_slips_by_what_is_left(make_aux_board):
    board = master_on(make_aux_board(), fifo=0xF9)
    board.wait_ms(300)
    assert board.byte(0x3A) & 0x10
    assert board.fifo_count() == 1024
    slip = 1024 % 20
    seen = stamps_us(board.rd(0x74, 1024)[slip:], 20, 14)
    assert np.all(np.diff(seen) == 1000)


def test_fifo_with_external_bytes_that_stops_keeps_the_oldest(make_aux_board):
    board = make_aux_board(personality=MPU6500)
    board.wr(0x1A, 0x41)
    master_on(board, fifo=0x09, dlpf=0x41)
    start_us = board.clock.now_ns() // 1000
    board.wait_ms(300)
    seen = stamps_us(board.rd(0x74, 512)[: 512 // 12 * 12], 12, 6)
    assert seen[0] - start_us < 2000
    assert np.all(np.diff(seen) == 1000)
    assert int.from_bytes(board.rd(EXT, 6), "big") - start_us > 299_000


def test_one_burst_over_sensors_and_external_data_is_one_sample(make_aux_board):
    board = master_on(make_aux_board())
    board.wait_ms(20.5)
    chip = board.chip
    chip.write(b"\x3b")
    first = chip.read(14)
    board.wait_ms(50)
    second = chip.read(24)
    chip.stop()
    assert first[4:6] == b"\x40\x00"
    us = int.from_bytes(second[:6], "big")
    now_us = board.clock.now_ns() // 1000 - 50_000
    assert 0 <= now_us - us <= 1000
    chip.write(bytes([EXT]))
    assert int.from_bytes(chip.read(6), "big") > us + 49_000
    chip.stop()


@pytest.mark.parametrize("fifo", [0x00, 0x01])
def test_a_long_gap_is_not_made_up_for(make_aux_board, fifo):
    board = master_on(make_aux_board(), fifo=fifo)
    board.wait_ms(3_600_000)
    board.byte(0x75)
    assert len(board.stamp.times_ns) < 300
    assert board.stamp.times_ns[-1] == pytest.approx(board.clock.now_ns(), abs=2e6)


def test_master_rests_while_the_chip_sleeps(make_aux_board):
    board = master_on(make_aux_board())
    board.wait_ms(10)
    board.wr(0x6B, 0x41)
    done = len(board.stamp.times_ns)
    board.wait_ms(100)
    board.byte(0x75)
    assert len(board.stamp.times_ns) == done > 5


def test_missing_chip_raises_the_masters_interrupt_at_each_sample_and_its_status_clears_on_read(make_aux_board):
    board = make_aux_board()
    board.wake(div=9)
    board.wr(0x38, MASTER_INT)
    slave(board, 2, READ | NOBODY)
    board.wr(0x6A, 0x20)
    board.byte(0x3A)
    since_ns = board.clock.now_ns()
    board.wait_ms(105)
    begins = [edge.t_ns for edge in board.chip.int_edges(since_ns) if edge.high]
    assert len(begins) in (10, 11)
    assert np.all(np.diff(begins) == 10_000_000)
    assert board.byte(0x3A) == MASTER_INT | DATA_READY
    assert board.byte(0x3A) == 0
    assert [board.byte(STATUS) for _ in range(2)] == [0x04, 0x00]


def test_pulses_of_the_master_and_of_data_ready_fall_together(make_aux_board):
    board = make_aux_board()
    board.wake()
    board.wr(0x38, MASTER_INT | DATA_READY)
    slave(board, 0, READ | NOBODY)
    board.wr(0x6A, 0x20)
    since_ns = board.clock.now_ns()
    board.wait_ms(50)
    edges = board.chip.int_edges(since_ns)
    times = [edge.t_ns for edge in edges]
    assert times == sorted(times)
    assert np.all(np.diff([edge.t_ns for edge in edges if edge.high]) == 1_000_000)


def test_sig_cond_reset_clears_the_external_data_too(make_aux_board):
    board = master_on(make_aux_board(), div=99)
    board.wait_ms(105)
    assert any(board.rd(EXT, 24))
    board.wr(0x6A, 0x21)
    assert board.rd(EXT, 24) == bytes(24)


def test_master_reset_gives_the_places_anew_only_while_the_master_is_off(make_aux_board):
    def second_place(user_ctrl):
        board = make_aux_board()
        board.wake()
        slave(board, 0, READ | CHIP, control=EN | 2)
        slave(board, 1, READ | OTHER, 0x40, control=EN | 3)
        board.wr(0x6A, 0x20)
        board.wait_ms(5)
        board.wr(0x27, 0)  # slave 0 is off, slave 1 keeps its place
        board.wr(0x6A, user_ctrl)
        board.wr(0x6A, 0x20)
        board.wait_ms(5)
        return board.rd(EXT, 3) == b"\x40\x41\x42"

    assert second_place(0x02)
    assert not second_place(0x22)
    assert not second_place(0x00)


@pytest.mark.parametrize("power", [0x40, 0x01])
def test_bypass_opens_awake_or_asleep_with_the_master_off(make_aux_board, power):
    board = make_aux_board()
    assert dict(board.chip.bypassed()) == {}
    board.wr(0x6B, 0x01)
    board.wr(0x37, 0x02)
    board.wr(0x6B, power)
    assert set(board.chip.bypassed()) == {CHIP, OTHER}
    board.wr(0x6A, 0x20)
    assert dict(board.chip.bypassed()) == {}


def test_chip_without_an_auxiliary_bus_keeps_what_is_written_to_its_master(board):
    board.wake()
    board.wr(0x24, 0x0D)
    slave(board, 0, READ | CHIP)
    board.wr(0x6A, 0x20)
    board.start_fifo(0x01)
    board.wait_ms(20)
    assert board.rd(0x24, 4) == bytes([0x0D, 0x8C, 0x00, 0x86])
    assert board.rd(EXT, 24) == bytes(24)
    assert board.byte(0x3A) & MASTER_INT == 0
    assert dict(board.chip.bypassed()) == {}


def opened(name, motion):
    board, clock = boards.board(name), VirtualClock()
    aux = board.aux_master(clock, motion)
    return FakeMpu6050(clock, motion=motion, imperfections=TYPICAL, personality=board.personality, aux=aux), clock


def said(chip, *messages):
    answers = []
    for message in messages:
        if isinstance(message, int):
            answers.append(chip.read(message))
        else:
            chip.write(bytes(message))
    chip.stop()
    return answers[-1] if answers else b""


def test_magnetometer_of_an_mpu_9250_comes_with_the_samples_as_it_does_through_the_bypass():
    """The way drivers do it: continuous measurement at 100 Hz by slave 0, then seven bytes from status 1 on."""
    motion = Turntable(start_s=0.0, ramp_s=0.5, rate_deg_s=90.0)
    chip, clock = opened("mpu-9250", motion)
    said(chip, [0x6B, 0x01])
    said(chip, [0x37, 0x02])
    magnetometer = chip.bypassed()[0x0C]
    assert said(magnetometer, [0x00], 1) == b"\x48"
    said(chip, [0x37, 0x00])
    said(chip, [0x1A, 0x01])
    said(chip, [0x25, 0x0C, 0x0A, 0x81])
    said(chip, [0x63, 0x16])
    said(chip, [0x6A, 0x20])
    clock.advance_ns(5_000_000)
    said(chip, [0x75], 1)
    said(chip, [0x25, 0x8C, 0x02, 0x88])
    seen = []
    for _ in range(400):
        clock.advance_ns(10_000_000)
        block = said(chip, [0x49], 8)
        seen.append(np.frombuffer(block[1:7], dtype="<i2").astype(float))
    field_ut = np.array(seen[50:]) * 0.15  # 16 bit
    level = field_ut[:, :2] - field_ut[:, :2].mean(axis=0)
    turned_deg = np.degrees(np.unwrap(np.arctan2(level[:, 1], level[:, 0])))
    assert abs(turned_deg[-1] - turned_deg[0]) == pytest.approx(90 * 3.49, abs=10)
    assert len(np.unique(field_ut, axis=0)) > 250
