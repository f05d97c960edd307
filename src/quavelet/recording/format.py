"""The layout of a recording, suffix `.qrec`; all numbers little-endian.

    magic line    ASCII "quavelet-recording 1\\n"; another number is another layout
    records       one after the other to the end of the file

    a record      marker 4 bytes | kind u8 | length u32 | CRC-32 u32 | payload of `length` bytes
    HEADER  1     JSON of `Header`: begins a stream. It stands twice, so that one damaged byte does not cost
                  the whole stream. A chip that was restarted begins another stream in the same file.
    DRAIN   2     seq u64, before_ns i64, after_ns i64, int_status u8, fifo_count u16, loss u8, then `Drain.data`;
                  the number of a `Loss`, an unknown one is TRANSFER
    END     3     no payload: the recording was closed as it should be
    EDGES   4     a DRAIN with pulses of the data-ready line: as it, and before the data the number of pulses u16 and
                  for each seq u64, t_ns i64
    others        are skipped by a reader

The CRC is over kind, length and payload. A HEADER's begins at 0, that of any other record goes on from the
CRC of its stream's HEADER. So a drain is never taken for one of another stream (whose ranges may differ)
where the HEADER between is damaged, nor for one of an older file where a file system lost power and shows
blocks that were never written.

A reader that meets a damaged record goes on at the next marker with a good CRC.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from zlib import crc32

import msgspec

from quavelet.bus.protocol import Edge
from quavelet.mpu6050.drain import Drain, Loss
from quavelet.mpu6050.stream import StreamInfo

SUFFIX = ".qrec"
VERSION = 1
MAGIC_WORD = b"quavelet-recording "
MAGIC = MAGIC_WORD + b"%d\n" % VERSION
MARKER = b"\xc7Q\xf2r"
MAX_PAYLOAD_BYTES = 1 << 17
"""A larger length is a damaged one; a drain is 64 KiB at most, a header a few KiB."""

_FRAME = struct.Struct("<4sBII")
_CHECKED = struct.Struct("<BI")
_DRAIN = struct.Struct("<QqqBHB")
_EDGES = struct.Struct("<H")
_EDGE = struct.Struct("<Qq")
FRAME_OVERHEAD_BYTES = _FRAME.size


class Kind(IntEnum):
    """What a record holds."""

    HEADER = 1
    DRAIN = 2
    END = 3
    EDGES = 4


_SHORTEST = {int(Kind.DRAIN): _DRAIN.size, int(Kind.EDGES): _DRAIN.size + _EDGES.size}


@dataclass(frozen=True, slots=True)
class Header:
    """What begins a stream.

    stream        the chip as configured
    settings      the settings in force, as plain tables: `parse_settings` makes `Settings` of them
    started_utc   wall-clock time when the stream began, ISO 8601, UTC
    started_ns    the same instant by the clock of the drains
    version       of the package that wrote it
    calibration   the text of the calibration's file that was in use, "" without one
    """

    stream: StreamInfo
    settings: dict[str, object]
    started_utc: str
    started_ns: int
    version: str
    calibration: str = ""


@dataclass(frozen=True, slots=True)
class Frame:
    """The first bytes of a record: what it claims to be."""

    kind: int
    length: int
    crc: int


def frame_at(buffer: bytes, position: int) -> Frame | None:
    """The frame at `position`, None where no record can begin; `FRAME_OVERHEAD_BYTES` must be there."""
    marker, kind, length, crc = _FRAME.unpack_from(buffer, position)
    shortest = _SHORTEST.get(kind, 0)
    if marker != MARKER or not shortest <= length <= MAX_PAYLOAD_BYTES:
        return None
    return Frame(kind, length, crc)


def checksum(kind: int, payload: bytes, *, stream_crc: int) -> int:
    """The CRC of a record; `stream_crc` is that of the stream's HEADER, 0 before the first."""
    begin = 0 if kind == Kind.HEADER else stream_crc
    return crc32(payload, crc32(_CHECKED.pack(kind, len(payload)), begin))


def pack_record(kind: Kind, payload: bytes, *, crc: int) -> bytes:
    """The record's bytes; `crc` as `checksum` gives it."""
    return _FRAME.pack(MARKER, kind, len(payload), crc) + payload


def pack_drain(drain: Drain) -> tuple[Kind, bytes]:
    """The kind and the payload of a drain's record: DRAIN, or EDGES where it has any."""
    head = _DRAIN.pack(drain.seq, drain.before_ns, drain.after_ns, drain.int_status, drain.fifo_count, drain.loss)
    if not drain.edges:
        return Kind.DRAIN, head + drain.data
    edges = b"".join(_EDGE.pack(edge.seq, edge.t_ns) for edge in drain.edges)
    return Kind.EDGES, head + _EDGES.pack(len(drain.edges)) + edges + drain.data


def drain_bytes(drain: Drain) -> int:
    """How long a drain's record is."""
    edges = _EDGES.size + len(drain.edges) * _EDGE.size if drain.edges else 0
    return FRAME_OVERHEAD_BYTES + _DRAIN.size + edges + len(drain.data)


def unpack_drain(kind: int, payload: bytes) -> Drain:
    """The drain of a DRAIN's or EDGES' payload. Raises struct.error where that is no such."""
    seq, before_ns, after_ns, int_status, fifo_count, code = _DRAIN.unpack_from(payload)
    loss = Loss(code) if code in Loss.__members__.values() else Loss.TRANSFER
    begin, edges = _DRAIN.size, tuple[Edge, ...]()
    if kind == Kind.EDGES:
        end = begin + _EDGES.size + _EDGES.unpack_from(payload, begin)[0] * _EDGE.size
        pairs = _EDGE.iter_unpack(payload[begin + _EDGES.size : end])
        begin, edges = end, tuple(Edge(t_ns, number) for number, t_ns in pairs)
    return Drain(seq, before_ns, after_ns, int_status, fifo_count, payload[begin:], loss, edges)


def pack_header(header: Header) -> bytes:
    """A HEADER's payload."""
    return msgspec.json.encode(header)


def unpack_header(payload: bytes) -> Header:
    """The header of a HEADER's payload; keys it does not know are ignored. Raises msgspec.DecodeError."""
    return msgspec.json.decode(payload, type=Header)
