"""Finding the records of a file, and the places between them where there should have been some."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

from quavelet.recording.format import FRAME_OVERHEAD_BYTES, MARKER, Frame, Kind, checksum, frame_at

CHUNK_BYTES = 1 << 16


@dataclass(frozen=True, slots=True)
class Record:
    """A record whose checksum is good; `after_damage` where it does not follow the one before."""

    kind: int
    payload: bytes
    after_damage: bool


class Scanner:
    """Gives the records of a file from where it stands, behind its magic line or behind a record; in bounded memory.

    stream_crc   of the last good HEADER before it, 0 where there is none
    byte         where in the file the next record is to begin
    places       damaged stretches found so far that are followed by a good record, or stand after the END
    first_byte   where in the file the first damage is, None while there is none
    truncated    the file has ended without an END
    """

    def __init__(self, file: BinaryIO, *, stream_crc: int = 0, places: int = 0, first_byte: int | None = None) -> None:
        self.stream_crc = stream_crc
        self.places = places
        self.first_byte = first_byte
        self.truncated = False
        self._file = file
        self._buffer = b""
        self._at = 0
        self._buffer_byte = file.tell()

    def __iter__(self) -> Iterator[Record]:
        damaged_byte: int | None = None
        last_kind: int | None = None
        while self._holds(FRAME_OVERHEAD_BYTES):
            record = self._take(after_damage=damaged_byte is not None)
            if record is None:
                if damaged_byte is None:
                    damaged_byte = self.byte
                self._skip_to_marker()
                continue
            if damaged_byte is not None:
                self._found_place(damaged_byte)
                damaged_byte = None
            last_kind = record.kind
            yield record
        if damaged_byte is None and self._at < len(self._buffer):
            damaged_byte = self.byte
        if last_kind != Kind.END:
            self.truncated = True
            self._found_damage(self.byte if damaged_byte is None else damaged_byte)
        elif damaged_byte is not None:
            self._found_place(damaged_byte)

    @property
    def byte(self) -> int:
        return self._buffer_byte + self._at

    def _holds(self, n: int) -> bool:
        """Whether the file has `n` more bytes; they are in the buffer then."""
        while len(self._buffer) - self._at < n:
            more = self._file.read(CHUNK_BYTES)
            if not more:
                return False
            self._buffer_byte += self._at
            self._buffer = self._buffer[self._at :] + more
            self._at = 0
        return True

    def _take(self, *, after_damage: bool) -> Record | None:
        """The record that begins here, None where there is no good one."""
        frame = frame_at(self._buffer, self._at)
        if frame is None or not self._holds(FRAME_OVERHEAD_BYTES + frame.length):
            return None
        payload = self._payload(frame)
        if frame.crc != checksum(frame.kind, payload, stream_crc=self.stream_crc):
            return None
        if frame.kind == Kind.HEADER:
            self.stream_crc = frame.crc
        self._at += FRAME_OVERHEAD_BYTES + frame.length
        return Record(frame.kind, payload, after_damage)

    def _payload(self, frame: Frame) -> bytes:
        begin = self._at + FRAME_OVERHEAD_BYTES
        return self._buffer[begin : begin + frame.length]

    def _skip_to_marker(self) -> None:
        """Go to the next marker, or as far as none can begin."""
        found = self._buffer.find(MARKER, self._at + 1)
        self._at = found if found >= 0 else max(self._at + 1, len(self._buffer) - len(MARKER) + 1)

    def _found_place(self, byte: int) -> None:
        self.places += 1
        self._found_damage(byte)

    def _found_damage(self, byte: int) -> None:
        if self.first_byte is None:
            self.first_byte = byte
