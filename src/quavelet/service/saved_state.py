"""The state file: what the attitude was, for a program that is started again within seconds.

A line that says what it is, a checksum, and MessagePack. It is replaced as a whole, so that there is always a whole
one; and whatever else stands there is refused with one sentence, never trusted and never an error.
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Mapping
from importlib.metadata import version
from math import prod
from pathlib import Path
from typing import Any, Literal, TypeVar
from zlib import crc32

import msgspec
import numpy as np
from numpy.typing import NDArray

from quavelet.attitude.heading import HeadingState
from quavelet.attitude.params import FilterState
from quavelet.attitude.yaw_zero import YawZeroState
from quavelet.calibration.still_bias import StillBiasState
from quavelet.core.paths import expanded
from quavelet.pipeline import PipelineState
from quavelet.settings import Settings
from quavelet.settings.service import AUTO

MAGIC = b"quavelet state 1\n"
MOST_BYTES = 1 << 20
"""A state takes some 20 kB."""
TABLES = ("bus", "chip", "offsets", "mounting", "magnetometer", "calibration", "start", "denoise", "filter", "heading")
"""Settings that an attitude depends on."""
_NUMBERS = ("<f8", "<i8", "|b1")
Three = tuple[float, float, float]
T = TypeVar("T")


class SavedState(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is in the file.

    version      of quavelet: the stages' memories are its own
    boot_id      of the machine's start
    boottime_ns  CLOCK_BOOTTIME of the last sample
    chip         its fingerprint
    digest       of the settings and the calibration, `digest_of`
    still        the attitude was settled and the board stood still
    force_m_s2   mean specific force while it did, and rate_rad_s the mean rate with its bias
    pipeline     the memories, in MessagePack
    """

    v: Literal[1] = 1
    version: str
    boot_id: str
    boottime_ns: int
    chip: str
    digest: str
    still: bool
    force_m_s2: Three
    rate_rad_s: Three
    pipeline: bytes


class NoState(Exception):
    """There is no state to go on from; the text says why, "" where there simply is no file."""


def state_path(settings: Settings, *, name: str, environ: Mapping[str, str]) -> Path | None:
    """Where the state is kept, None for nowhere."""
    asked = settings.service.state_file
    if asked != AUTO:
        return expanded(asked) if asked else None
    folder = environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    return Path(folder, f"{name}.state") if folder else None


def digest_of(settings: Settings, calibration: str) -> str:
    """Of all that the attitude depends on besides the chip: the settings, and the text of the calibration in use."""
    tables = {table: getattr(settings, table) for table in TABLES}
    plain = msgspec.msgpack.encode([version("quavelet"), tables, calibration], order="deterministic")
    return hashlib.sha256(plain).hexdigest()


def write_state(path: Path, saved: SavedState) -> None:
    """Replace the file by this state. Raises OSError, and leaves the old one as it was."""
    payload = msgspec.msgpack.encode(saved)
    data = MAGIC + crc32(payload).to_bytes(4, "little") + payload
    new = path.with_name(f".{path.name}.new")
    try:
        descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
        with os.fdopen(descriptor, "wb", buffering=0) as file:
            while data:
                data = data[file.write(data) :]
            os.fsync(file.fileno())
        new.replace(path)
    except OSError:
        new.unlink(missing_ok=True)
        raise


def read_state(path: Path) -> SavedState:
    """The state in the file. Raises NoState."""
    data = _read(path)
    payload = data[len(MAGIC) + 4 :]
    if not data.startswith(MAGIC):
        raise NoState("it is no state of quavelet's")
    if crc32(payload).to_bytes(4, "little") != data[len(MAGIC) : len(MAGIC) + 4]:
        raise NoState("it is damaged")
    try:
        return msgspec.msgpack.decode(payload, type=SavedState)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        raise NoState("it is of another version") from None


def _read(path: Path) -> bytes:
    """Not from a link, a pipe or a device, and no more than a state can be."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as file:
            about = os.fstat(descriptor)
            if not stat.S_ISREG(about.st_mode):
                raise NoState("it is no file")
            if about.st_size > MOST_BYTES:
                raise NoState(f"it has {about.st_size} bytes, which no state has")
            return file.read(MOST_BYTES)
    except FileNotFoundError:
        raise NoState("") from None
    except OSError as error:
        raise NoState(f"it cannot be read ({error.strerror})") from None


def pack_pipeline(state: PipelineState) -> bytes:
    """The memories as plain data. That of the denoising is left out: it begins anew after a gap in any case."""
    plain = {
        "kind": type(state.filter).__name__,
        "still_bias": state.still_bias,
        "filter": state.filter,
        "heading": state.heading,
        "yaw_zero": state.yaw_zero,
    }
    return msgspec.msgpack.encode(plain, enc_hook=_plain)


def unpack_pipeline(packed: bytes, *, like: PipelineState) -> PipelineState:
    """The memories for a pipeline whose own are `like`. Raises NoState where they are not of its kind."""
    try:
        plain = msgspec.msgpack.decode(packed)
        kind = type(like.filter)
        if plain["kind"] != kind.__name__ or (plain["heading"] is None) != (like.heading is None):
            raise NoState("it is of other settings")
        heading = None if like.heading is None else _made(plain["heading"], HeadingState)
        attitude: FilterState = _made(plain["filter"], kind)
        yaw_zero = _made(plain["yaw_zero"], YawZeroState)
        return PipelineState(_made(plain["still_bias"], StillBiasState), None, attitude, heading, yaw_zero)
    except (msgspec.DecodeError, ArithmeticError, LookupError, RecursionError, TypeError, ValueError):
        raise NoState("what is in it does not fit") from None


def _made(plain: object, kind: type[T]) -> T:
    return msgspec.convert(plain, kind, dec_hook=_array)


def _plain(thing: object) -> object:
    if isinstance(thing, np.ndarray):
        numbers = np.ascontiguousarray(thing)
        return {"kind": numbers.dtype.str, "shape": list(numbers.shape), "bytes": numbers.tobytes()}
    if isinstance(thing, np.generic):
        return thing.item()
    raise TypeError(f"a memory of a stage holds a {type(thing).__name__}, which cannot be kept")


def _array(kind: type, plain: object) -> NDArray[Any]:
    """A numpy array of plain data. Raises ValueError, TypeError or LookupError where it is none."""
    del kind
    if not isinstance(plain, dict) or plain["kind"] not in _NUMBERS:
        raise ValueError("no array")
    shape = [int(n) for n in plain["shape"]]
    if len(shape) > 3 or min(shape, default=0) < 0 or prod(shape) > MOST_BYTES:
        raise ValueError("no shape")
    return np.frombuffer(plain["bytes"], dtype=plain["kind"]).reshape(shape).copy()
