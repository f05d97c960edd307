"""A recording that was cut or damaged gives all it holds, nothing it never held, and says so."""

import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recorded import INFO, drains, first_drain_byte, record

from quavelet.core.errors import RecordingError
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.stream import StreamInfo
from quavelet.recording.format import MAGIC, MARKER
from quavelet.recording.reader import RecordingReader
from quavelet.recording.scan import CHUNK_BYTES

DRAINS = drains(12)
ITEMS: list[StreamInfo | Drain] = [INFO, *DRAINS]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return record(tmp_path_factory.mktemp("whole") / "a.qrec", ITEMS).read_bytes()


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damage") / "a.qrec"


def read(path: Path) -> tuple[list[StreamInfo | Drain], str]:
    """What the file gives, and the sentence about what it does not."""
    reader = RecordingReader(path)
    items = list(reader)
    try:
        reader.check()
    except RecordingError as error:
        return items, str(error)
    return items, ""


def test_a_cut_at_any_byte_costs_only_the_record_it_is_in(whole: bytes, scratch: Path) -> None:
    for n in range(len(whole)):
        scratch.write_bytes(whole[:n])
        try:
            items, sentence = read(scratch)
        except RecordingError as error:
            assert n < first_drain_byte(whole), f"cut at {n}"
            assert str(scratch) in str(error)
            continue
        record_bytes = (len(whole) - 13 - first_drain_byte(whole)) // len(DRAINS)
        there = max(0, n - first_drain_byte(whole)) // record_bytes
        assert items == ITEMS[: 1 + there], f"cut at {n}"
        assert "cut off" in sentence, f"cut at {n}"


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_flipped_bytes_never_give_a_drain_that_was_not_written(
    whole: bytes, scratch: Path, data: st.DataObject
) -> None:
    flips = data.draw(st.dictionaries(st.integers(0, len(whole) - 1), st.integers(1, 255), min_size=1, max_size=4))
    damaged = bytearray(whole)
    for byte, mask in flips.items():
        damaged[byte] ^= mask
    scratch.write_bytes(damaged)
    try:
        items, sentence = read(scratch)
    except RecordingError:
        assert min(flips) < first_drain_byte(whole)
        return
    assert sentence
    assert items[0] == INFO
    kept = [item for item in items[1:] if isinstance(item, Drain)]
    assert len(kept) == len(items) - 1 >= len(DRAINS) - len(flips)
    assert [d.seq for d in kept] == sorted({d.seq for d in kept})
    assert set(kept) <= set(DRAINS)


@settings(deadline=None)
@given(st.data())
def test_bytes_put_in_or_taken_out_cost_only_the_records_they_touch(
    whole: bytes, scratch: Path, data: st.DataObject
) -> None:
    first = first_drain_byte(whole)
    at = data.draw(st.integers(first, len(whole)))
    taken = data.draw(st.integers(0, 100))
    put = data.draw(st.one_of(st.binary(max_size=100), st.lists(st.just(MARKER), max_size=20).map(b"".join)))
    scratch.write_bytes(whole[:at] + put + whole[at + taken :])
    items, _ = read(scratch)
    assert items[0] == INFO
    assert set(items[1:]) <= set(DRAINS)
    assert len(items) - 1 >= len(DRAINS) - 3


@pytest.mark.parametrize("at", [0, 5, 11])
def test_a_damaged_drain_costs_itself_alone_and_its_place_is_told(whole: bytes, scratch: Path, at: int) -> None:
    first = first_drain_byte(whole)
    record_bytes = (len(whole) - 13 - first) // len(DRAINS)
    damaged = bytearray(whole)
    damaged[first + at * record_bytes + 20] ^= 1
    scratch.write_bytes(damaged)
    items, sentence = read(scratch)
    assert items == [INFO, *DRAINS[:at], *DRAINS[at + 1 :]]
    place = first + at * record_bytes
    lost = "0 drains" if at == 11 else "1 drain"  # what stood before the END has no number after it
    assert sentence == (f"{scratch}: damaged at byte {place} (1 place, {lost} lost): all that could be read was given")


def test_a_header_damaged_once_costs_nothing(whole: bytes, scratch: Path) -> None:
    half = (first_drain_byte(whole) - len(MAGIC)) // 2
    for copy in (0, 1):
        damaged = bytearray(whole)
        damaged[len(MAGIC) + copy * half + 40] ^= 1
        scratch.write_bytes(damaged)
        items, sentence = read(scratch)
        assert items == ITEMS
        assert "(1 place, 0 drains lost)" in sentence


def test_drains_behind_a_lost_header_are_not_taken_for_the_stream_before(scratch: Path) -> None:
    other = replace(INFO, gyro_config=24)
    one = record(scratch, [INFO, *DRAINS]).read_bytes()[:-13]
    both = record(scratch, [INFO, *DRAINS, other, *drains(7, frames=3), INFO, *DRAINS]).read_bytes()
    damaged = bytearray(both)
    length = int.from_bytes(both[len(one) + 5 : len(one) + 9], "little")
    damaged[len(one) + 30] ^= 1
    damaged[len(one) + 13 + length + 30] ^= 1
    scratch.write_bytes(damaged)
    items, sentence = read(scratch)
    assert items == [INFO, *DRAINS, INFO, *DRAINS]
    assert "1 place" in sentence


def test_disk_blocks_of_an_older_recording_behind_a_power_cut_are_not_taken_for_this_one(scratch: Path) -> None:
    older = record(scratch, [INFO, *drains(8, first=3)]).read_bytes()
    newer = record(scratch, ITEMS).read_bytes()
    cut = newer[: first_drain_byte(newer) + 100]
    scratch.write_bytes(cut + older[len(cut) :])
    items, _ = read(scratch)
    assert items == ITEMS[: len(items)]
    assert len(items) == 2


def test_zeros_behind_a_power_cut_cost_no_drain(whole: bytes, scratch: Path) -> None:
    scratch.write_bytes(whole[:-13] + bytes(300_000))
    items, sentence = read(scratch)
    assert items == ITEMS
    assert sentence.startswith(f"{scratch}: cut off, or never closed, at byte {len(whole) - 13}, what came after 20")
    assert sentence.endswith(" is missing: all that could be read was given")


def test_bytes_behind_the_end_are_told(whole: bytes, scratch: Path) -> None:
    scratch.write_bytes(whole + b"more")
    items, sentence = read(scratch)
    assert items == ITEMS
    assert f"damaged at byte {len(whole)}" in sentence


def test_a_damaged_length_does_not_swallow_what_follows(whole: bytes, scratch: Path) -> None:
    first = first_drain_byte(whole)
    damaged = bytearray(whole)
    damaged[first + 5 : first + 9] = (100_000).to_bytes(4, "little")
    scratch.write_bytes(damaged)
    assert read(scratch)[0] == [INFO, *DRAINS[1:]]


def test_a_marker_across_two_reads_of_the_file_is_found(whole: bytes, scratch: Path) -> None:
    first = first_drain_byte(whole)
    boundary = len(MAGIC) + CHUNK_BYTES
    for hole in range(boundary - first - 8, boundary - first + 8):
        scratch.write_bytes(whole[:first] + bytes(hole) + whole[first:])
        assert read(scratch)[0] == ITEMS, f"hole of {hole} bytes"


def test_a_damaged_length_does_not_take_the_whole_file_into_memory(whole: bytes, scratch: Path) -> None:
    first = first_drain_byte(whole)
    damaged = bytearray(whole) + bytes(8_000_000)
    damaged[first + 5 : first + 9] = (7_000_000).to_bytes(4, "little")
    scratch.write_bytes(damaged)
    reader = RecordingReader(scratch)
    tracemalloc.start()
    assert list(reader) == [INFO, *DRAINS[1:]]
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 500_000


def magic_of_version(number: int) -> Callable[[bytes], bytes]:
    return lambda data: b"quavelet-recording %d\n" % number + data[len(MAGIC) :]


def no_header(data: bytes) -> bytes:
    return MAGIC + data[first_drain_byte(data) :]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda _: b"", "is empty"),
        (lambda data: data[:7], "was cut off within its first line"),
        (lambda _: b"t,ax,ay,az\n1,2,3,4\n" * 100, "is not a recording"),
        (lambda _: bytes(range(256)) * 10, "is not a recording"),
        (magic_of_version(2), "is a recording of format 2, this version reads 1: update quavelet"),
        (no_header, "has a damaged header"),
        (lambda data: data[: len(MAGIC) + 50], "has a damaged header"),
        (lambda _: MAGIC, "holds no stream"),
    ],
)
def test_what_is_no_recording_is_refused_with_its_own_sentence(
    whole: bytes, scratch: Path, change: Callable[[bytes], bytes], sentence: str
) -> None:
    scratch.write_bytes(change(whole))
    with pytest.raises(RecordingError, match=sentence) as caught:
        RecordingReader(scratch)
    assert str(caught.value).startswith(str(scratch))


def test_a_recording_closed_before_the_chip_streamed_says_so(scratch: Path) -> None:
    with pytest.raises(RecordingError, match="holds no stream"):
        RecordingReader(record(scratch, []))


def test_a_chip_of_another_kind_is_refused(scratch: Path) -> None:
    record(scratch, [replace(INFO, who_am_i=0x5A), *DRAINS])
    with pytest.raises(RecordingError, match="WHO_AM_I 0x5a"):
        RecordingReader(scratch)


def test_a_later_stream_of_another_chip_is_refused_after_all_before_it(scratch: Path) -> None:
    record(scratch, [*ITEMS, replace(INFO, who_am_i=0x5A), *DRAINS])
    given_items = []
    with pytest.raises(RecordingError, match="WHO_AM_I 0x5a"):
        for item in RecordingReader(scratch):
            given_items.append(item)
    assert given_items == ITEMS


def test_a_missing_file_or_a_folder_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="there is no recording"):
        RecordingReader(tmp_path / "none.qrec")
    with pytest.raises(RecordingError, match="is a folder"):
        RecordingReader(tmp_path)


def test_a_header_of_other_fields_is_refused(scratch: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("quavelet.recording.writer.pack_header", lambda _: b'{"stream": 3}')
    record(scratch, ITEMS)
    with pytest.raises(RecordingError, match="does not understand"):
        RecordingReader(scratch)
