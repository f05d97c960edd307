"""A recording through the FIFO, byte for byte."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hw_fakes import RecordedCounts, open_fake
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import EndOfData, SettingsError

N = 500
RATE_HZ = 99.3


def arrays():
    rng = np.random.default_rng(1)
    return {
        "acc": rng.integers(-32768, 32768, (N, 3)).astype(np.int16),
        "gyr": rng.integers(-32768, 32768, (N, 3)).astype(np.int16),
        "temp": np.arange(N, dtype=np.int16),
        "acc_lsb_per_g": np.array(4096),
        "gyr_lsb_per_dps": np.array(131),
        "rate": np.array(RATE_HZ),
    }


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "walk.npz"
    np.savez(path, **arrays())
    return path


@pytest.fixture
def played(make_board, file):
    return make_board(open_bus=lambda clock: open_fake(f"counts:{file}", clock=clock))


def read_all(board):
    """All frames up to the end, which must be announced as such."""
    parts = []
    for _ in range(100_000):
        board.wait_ms(40)
        try:
            parts.append(board.drain())
        except EndOfData:
            return np.concatenate(parts)
    raise AssertionError("the recording never ends")


def recorded():
    data = arrays()
    return np.column_stack([data["acc"], data["temp"], data["gyr"]])


@pytest.mark.parametrize("clksel", [0, 1])
def test_every_frame_comes_once_and_byte_for_byte_then_the_end(played, clksel):
    played.wake(dlpf=3, div=9, accel=0x10, clksel=clksel)
    played.wait_ms(1234)
    played.start_fifo()
    start_ns = played.clock.now_ns()
    assert np.array_equal(read_all(played), recorded())
    assert (played.clock.now_ns() - start_ns) * 1e-9 == pytest.approx(N / RATE_HZ, abs=0.1)


def test_end_is_told_only_to_who_asks_for_samples(played):
    played.wake(dlpf=3, div=9, accel=0x10)
    played.start_fifo()
    read_all(played)
    assert played.byte(0x75) == 0x68
    assert played.byte(0x1C) == 0x10
    with pytest.raises(EndOfData, match="at its end"):
        played.byte(0x3A)
    with pytest.raises(EndOfData):
        played.rd(0x74, 14)
    played.wr(0x6B, 0x40)
    assert played.byte(0x6B) == 0x40
    assert played.rd(0x3B, 14) == bytes(14)


def test_registers_show_frame_0_until_the_fifo_is_on(played):
    played.wake(dlpf=3, div=9, accel=0x10)
    for _ in range(3):
        played.wait_ms(N / RATE_HZ * 1e3)
        assert np.array_equal(played.sensors(), recorded()[0])


def test_registers_go_on_with_the_fifo(played):
    played.wake(dlpf=3, div=9, accel=0x10)
    played.start_fifo()
    played.wait_ms(55)
    frames = played.drain()
    assert np.array_equal(frames, recorded()[: len(frames)])
    assert np.array_equal(played.sensors(), frames[-1])


def test_other_ranges_rescale_round_and_clip(played):
    played.wake(dlpf=3, div=9, accel=0x00, gyro=0x08)
    played.start_fifo()
    found, raw = read_all(played), recorded().astype(float)
    assert np.array_equal(found[:, :3], np.clip(raw[:, :3] * 4, -32768, 32767))
    assert np.array_equal(found[:, 3], raw[:, 3])
    assert np.array_equal(found[:, 4:], np.clip(np.rint(raw[:, 4:] / 2), -32768, 32767))


@pytest.mark.parametrize("div", [1, 4, 19, 12])
def test_other_rates_never_play_at_the_wrong_speed(played, div):
    played.wake(dlpf=3, div=div, accel=0x10)
    played.start_fifo()
    index = read_all(played)[:, 3]
    assert np.array_equal(index, (np.arange(len(index)) * (1 + div)) // 10)
    assert N - 3 < index[-1] < N


def test_8_khz_plays_at_the_same_speed(played):
    played.wake(dlpf=0, div=79, accel=0x10)
    played.start_fifo()
    assert np.array_equal(read_all(played)[:, 3], np.arange(N))


def test_a_change_of_rate_on_the_way_keeps_the_time(played):
    played.wake(dlpf=3, div=9, accel=0x10)
    played.start_fifo()
    start_ns = played.clock.now_ns()
    played.wait_ms(1000)
    played.wr(0x19, 4)
    played.wait_ms(1000)
    elapsed_s = (played.clock.now_ns() - start_ns) * 1e-9
    assert played.sensors()[3] == pytest.approx(elapsed_s * RATE_HZ, abs=2)


def test_reset_and_new_start_go_on_in_time_not_from_the_beginning(played):
    played.wake(dlpf=3, div=9, accel=0x10)
    played.start_fifo()
    played.wait_ms(1000)
    played.wr(0x6B, 0x80)
    played.wait_ms(1000)
    played.wake(dlpf=3, div=9, accel=0x10)
    played.start_fifo()
    played.wait_ms(100)
    assert played.drain()[0, 3] == pytest.approx(2 * RATE_HZ, abs=3)


def test_true_rate_is_the_recorded_one(played):
    played.wake(dlpf=3, div=9)
    assert played.chip.true_rate_hz() == pytest.approx(RATE_HZ)
    assert played.chip.motion is None


@pytest.mark.parametrize("missing", list(arrays()))
def test_incomplete_recording_is_refused_by_name(tmp_path, missing):
    data = arrays()
    del data[missing]
    path = tmp_path / "part.npz"
    np.savez(path, **data)
    with pytest.raises(SettingsError, match=rf"part\.npz.*'{missing}'"):
        RecordedCounts.load(path)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("acc", np.zeros((N, 2), dtype=np.int16)),
        ("gyr", np.zeros((N, 3))),
        ("temp", np.zeros((N, 1), dtype=np.int16)),
        ("temp", np.zeros(N - 1, dtype=np.int16)),
        ("rate", np.array([1.0, 2.0])),
        ("rate", np.array(0.0)),
        ("acc_lsb_per_g", np.array("many")),
    ],
)
def test_malformed_recording_is_refused_by_name(tmp_path, name, value):
    path = tmp_path / "odd.npz"
    np.savez(path, **{**arrays(), name: value})
    with pytest.raises(SettingsError, match=rf"({name}|temp).*odd\.npz"):
        RecordedCounts.load(path)


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x03\x04 half of one"])
def test_corrupt_file_is_refused_by_name(tmp_path, content):
    path = tmp_path / "bad.npz"
    path.write_bytes(content)
    with pytest.raises(SettingsError, match=r"bad\.npz"):
        open_fake(f"counts:{path}", clock=VirtualClock())


def test_truncated_file_is_refused_by_name(file):
    file.write_bytes(file.read_bytes()[:-100])
    with pytest.raises(SettingsError, match=r"walk\.npz"):
        RecordedCounts.load(file)


def test_plain_npy_is_refused_by_name(tmp_path):
    np.save(tmp_path / "plain.npy", np.zeros(3))
    with pytest.raises(SettingsError, match=r"plain\.npy"):
        RecordedCounts.load(tmp_path / "plain.npy")


def test_absent_file_is_refused_by_name(tmp_path):
    with pytest.raises(SettingsError, match=r"nowhere\.npz"):
        open_fake(f"counts:{tmp_path / 'nowhere.npz'}", clock=VirtualClock())


RECORDINGS = Path(__file__).parents[3] / "shared" / "recordings"
REAL = sorted(RECORDINGS.glob("sunsided_*.npz"))


@pytest.mark.skipif(not REAL, reason="the real recordings do not lie beside the project")
def test_real_recordings_come_back_byte_for_byte(make_board):
    for path in REAL:
        board = make_board(open_bus=lambda clock, path=path: open_fake(f"counts:{path}", clock=clock))
        board.wake(dlpf=3, div=9, accel=0x10)
        board.start_fifo()
        assert np.array_equal(read_all(board), RecordedCounts.load(path).frames), path.name
