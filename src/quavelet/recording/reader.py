"""Reading a recording: all that can be read of it, and then what could not."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta
from os import SEEK_END
from pathlib import Path
from typing import BinaryIO

import msgspec

from quavelet.core.errors import RecordingError, SettingsError, WrongChip
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.magnetometer.field import plan_of
from quavelet.mpu6050.stream import StreamInfo
from quavelet.recording.format import MAGIC, MAGIC_WORD, VERSION, Header, Kind, checksum, unpack_drain, unpack_header
from quavelet.recording.scan import Record, Scanner

_MAGIC_LINE_BYTES = 40
_TAIL_BYTES = 1 << 16
"""So much is looked through for the last drain: a drain at least, but where a chip was restarted at the very end."""


@dataclass(frozen=True, slots=True)
class Damage:
    """What was found wrong with a recording.

    places       damaged stretches between records
    first_byte   where in the file the first damage is, None where there is none
    drains_lost  drain numbers missing where a damaged stretch is; at the file's end nobody knows
    truncated    the file ends without the record that `close` writes: it was cut, or never closed
    last_ns      time of the last drain that was read, None before the first
    """

    places: int = 0
    first_byte: int | None = None
    drains_lost: int = 0
    truncated: bool = False
    last_ns: int | None = None

    @property
    def found(self) -> bool:
        """Whether anything is wrong."""
        return self.places > 0 or self.truncated

    @property
    def records(self) -> int:
        """So many records at least could not be read."""
        return max(self.places, self.drains_lost)


@dataclass(frozen=True, slots=True)
class Position:
    """A place behind an item, from which a recording can be read on.

    byte        in the file
    stream_crc  of the header in force, which the checksums of the drains go on from; 0 before the first
    header      its payload
    next_seq    the drain's number expected next
    last_ns     time of the last drain, None before the first
    damage      found up to here
    """

    byte: int = len(MAGIC)
    stream_crc: int = 0
    header: bytes = b""
    next_seq: int = 0
    last_ns: int | None = None
    damage: Damage = Damage()


class RecordingReader:
    """The recording in the file `path`.

    Iterating gives, in bounded memory, each stream's `StreamInfo` and then its drains; it may be done again.
    `header` is the first stream's; `damage` what the iteration has found up to now, and `position` where it stands.
    Raises RecordingError where there is no recording, or one this version cannot read.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.damage = Damage()
        self.position = Position()
        self._first_payload = b""
        self.header = self._first_header()

    def __iter__(self) -> Iterator[StreamInfo | Drain]:
        return self.from_position(Position())

    def from_position(self, position: Position) -> Iterator[StreamInfo | Drain]:
        """All items behind `position`, as the iteration that it was taken from gave them."""
        self.position, self.damage = position, position.damage
        return self._items(position)

    def last_ns(self) -> int | None:
        """Time of the file's last drain by a look at its end alone; None where that is not of the first stream."""
        payload = self._first_payload
        with self._opened() as file:
            size = file.seek(0, SEEK_END)
            file.seek(max(len(MAGIC), size - _TAIL_BYTES))
            scanner = Scanner(file, stream_crc=checksum(Kind.HEADER, payload, stream_crc=0))
            last: Record | None = None
            for record in scanner:
                if record.kind in (Kind.DRAIN, Kind.EDGES):
                    last = record
                elif record.kind == Kind.HEADER and record.payload != payload:
                    return None
        return unpack_drain(last.kind, last.payload).after_ns if last else None

    def size_bytes(self) -> int:
        """How long the file is at this moment. Raises RecordingError."""
        with self._opened() as file:
            return file.seek(0, SEEK_END)

    def _items(self, begin: Position) -> Iterator[StreamInfo | Drain]:
        expected, lost, last_ns = begin.next_seq, begin.damage.drains_lost, begin.last_ns
        previous = begin.header
        with self._opened() as file:
            file.seek(begin.byte)
            damage = begin.damage
            scanner = Scanner(file, stream_crc=begin.stream_crc, places=damage.places, first_byte=damage.first_byte)
            for record in scanner:
                item: StreamInfo | Drain | None = None
                if record.kind in (Kind.DRAIN, Kind.EDGES):
                    item = unpack_drain(record.kind, record.payload)
                    if record.after_damage:
                        lost += max(0, item.seq - expected)
                    expected = item.seq + 1
                    last_ns = item.after_ns
                elif record.kind == Kind.HEADER and record.payload != previous:
                    item = self._header_of(record.payload).stream
                    previous, expected = record.payload, 0
                self._note(scanner, lost, last_ns)
                if item is not None:
                    self.position = Position(scanner.byte, scanner.stream_crc, previous, expected, last_ns, self.damage)
                    yield item
            self._note(scanner, lost, last_ns)

    def check(self) -> None:
        """Raise RecordingError if what has been read up to now was damaged."""
        damage = self.damage
        if not damage.found:
            return
        what = "cut off, or never closed," if not damage.places else "damaged"
        where = f"{self.path}: {what} at byte {damage.first_byte}"
        if damage.places:
            where += f" ({_number(damage.places, 'place')}, {_number(damage.drains_lost, 'drain')} lost)"
            if damage.truncated:
                where += " and cut off at its end"
        if damage.truncated:
            where += f", what came after {self._utc(damage.last_ns)} is missing"
        raise RecordingError(f"{where}: all that could be read was given")

    def _utc(self, t_ns: int | None) -> str:
        """A time of a drain in words, by the clock that stands in the header."""
        if t_ns is None:
            return "its header"
        try:
            begun = datetime.fromisoformat(self.header.started_utc)
            at = begun + timedelta(microseconds=(t_ns - self.header.started_ns) // 1000)
        except (ValueError, OverflowError):
            return f"{t_ns} ns of its clock"
        return at.isoformat(timespec="milliseconds")

    def _note(self, scanner: Scanner, lost: int, last_ns: int | None) -> None:
        if scanner.places or scanner.truncated:
            self.damage = Damage(scanner.places, scanner.first_byte, lost, scanner.truncated, last_ns)

    def _first_header(self) -> Header:
        with self._opened() as file:
            self._check_magic(file.read(_MAGIC_LINE_BYTES))
            file.seek(len(MAGIC))
            scanner = Scanner(file)
            ended = False
            for record in scanner:
                if record.kind == Kind.HEADER:
                    self._first_payload = record.payload
                    return self._header_of(record.payload)
                ended = ended or record.kind == Kind.END
            if scanner.places == 0 and (ended or scanner.first_byte == len(MAGIC) == file.tell()):
                raise RecordingError(f"{self.path} holds no stream: it ended before the chip gave data; record again")
        raise RecordingError(
            f"{self.path} has a damaged header, nothing can be decoded without it: take another copy of it"
        )

    def _check_magic(self, begin: bytes) -> None:
        if not begin:
            raise RecordingError(f"{self.path} is empty: give a recording made by `quavelet run --record`")
        if begin.startswith(MAGIC):
            return
        if MAGIC.startswith(begin):
            raise RecordingError(f"{self.path} was cut off within its first line: nothing is left in it, record again")
        number, newline, _ = begin.removeprefix(MAGIC_WORD).partition(b"\n")
        if begin.startswith(MAGIC_WORD) and newline and number.isdigit():
            raise RecordingError(
                f"{self.path} is a recording of format {int(number)}, this version reads {VERSION}: update quavelet"
            )
        raise RecordingError(f"{self.path} is not a recording: give a file made by `quavelet run --record`")

    def _header_of(self, payload: bytes) -> Header:
        try:
            header = unpack_header(payload)
            _ = header.stream.variant
            if header.stream.magnetometer:
                plan_of(header.stream.magnetometer)
        except msgspec.DecodeError as error:
            raise RecordingError(
                f"{self.path} has a header this version does not understand ({error}): update quavelet"
            ) from error
        except SettingsError as error:
            raise RecordingError(
                f"{self.path} has a magnetometer this version does not understand ({error}): update quavelet"
            ) from error
        except WrongChip as error:
            raise RecordingError(
                f"{self.path} is of a chip this version does not know (WHO_AM_I 0x{error.found:02x}): update quavelet"
            ) from error
        return header

    @contextmanager
    def _opened(self) -> Iterator[BinaryIO]:
        try:
            with self.path.open("rb", buffering=0) as file:
                yield file
        except FileNotFoundError as error:
            raise RecordingError(f"there is no recording {self.path}: check the name") from error
        except IsADirectoryError as error:
            raise RecordingError(f"{self.path} is a folder: give the recording's file in it") from error
        except PermissionError as error:
            raise RecordingError(f"{self.path} may not be read by this user: change its permissions") from error
        except OSError as error:
            raise RecordingError(f"{self.path} cannot be read on ({error.strerror}): check the disk") from error


def _number(n: int, word: str) -> str:
    return f"{n} {word}" if n == 1 else f"{n} {word}s"
