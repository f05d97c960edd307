"""The session's file, beside the calibration that comes of it: what was measured, to go on from."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import msgspec

from quavelet.bench.session_evidence import Chip, Evidence
from quavelet.core.errors import CalibrationError

VERSION = 2


class Kept(msgspec.Struct, frozen=True, kw_only=True):
    """What is in the file, as MessagePack."""

    quavelet_session: int
    evidence: Evidence


class SessionStore:
    """The file `OUT.session`. It is replaced as a whole, so it always holds one whole session or is not there.

    failure   why it could not be written the last time, "" where it could
    """

    def __init__(self, out: Path) -> None:
        self.path = out.with_name(f"{out.name}.session")
        self.failure = ""
        self._written = -1
        self._unwritten: Evidence | None = None

    def load(self, chip: Chip | None = None) -> Evidence:
        """What was measured. Raises CalibrationError where there is nothing, or it is not of this chip and setting."""
        try:
            kept = msgspec.msgpack.decode(self.path.read_bytes(), type=Kept)
        except FileNotFoundError:
            raise CalibrationError(f"there is no session {self.path} to resume: leave --resume out") from None
        except (OSError, msgspec.DecodeError) as error:
            raise CalibrationError(f"{self.path} cannot be read ({error}): remove it, and begin anew") from error
        if kept.quavelet_session != VERSION:
            raise CalibrationError(f"{self.path} is of another version of quavelet: remove it, and begin anew")
        if chip is not None and not _is_same(kept.evidence.chip, chip):
            raise CalibrationError(
                f"{self.path} is of another chip, or one set otherwise ({_in_words(kept.evidence.chip)}; this is "
                f"{_in_words(chip)}): remove it, and begin anew"
            )
        if chip is not None:
            kept.evidence.chip = chip
        return kept.evidence

    def keep(self, evidence: Evidence) -> bool:
        """Write what is new. False where it cannot be: `failure` says why, and what was there before still is."""
        if evidence.count() == self._written:
            return not self.failure
        try:
            _replace(self.path, evidence)
        except OSError as error:
            self._unwritten = evidence
            self.failure = f"{self.path} cannot be written ({error.strerror}): make room, nothing measured is lost yet"
            return False
        self._written, self._unwritten, self.failure = evidence.count(), None, ""
        return True

    def last_words(self, *, then: str) -> str:
        """What is to be said of the file at the end of a session that was not finished, and that `then` it goes on;
        "" where there is no file.

        What could not be written is put into another folder, if there is one that takes it.
        """
        if self._unwritten is None and not self._written:
            self.forget()  # Nothing was measured: the next session is not to stumble over it.
        if self._unwritten is None or self.keep(self._unwritten):
            return f"what was measured is kept in {self.path}: {then}" if self.path.exists() else ""
        why = self.failure.partition(": make room")[0]
        for folder in _elsewhere(self.path.parent):
            other = folder / self.path.name
            with suppress(OSError):
                _replace(other, self._unwritten)
                return f"{why}: what was measured is kept in {other}; make room, move it there, and {then}"
        if self.path.exists():
            return f"{why}, nor anywhere else: make room, and with what the file holds from before {then}"
        return f"{why}, nor anywhere else: what was measured is lost; make room, and begin anew"

    def forget(self) -> None:
        """The session is finished: remove its file."""
        self.path.unlink(missing_ok=True)


def _elsewhere(folder: Path) -> Iterator[Path]:
    """Other folders, made where there is none."""
    if Path.home() != folder:
        yield Path.home()
    with suppress(OSError):
        made = Path(tempfile.mkdtemp(prefix="quavelet-"))
        yield made
        made.rmdir()  # asked for another: this one took nothing


def _replace(path: Path, evidence: Evidence) -> None:
    """All of it, or nothing. Raises OSError."""
    data = msgspec.msgpack.encode(Kept(quavelet_session=VERSION, evidence=evidence))
    beside = path.with_name(f"{path.name}.new")
    try:
        with beside.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
        raise


def _is_same(kept: Chip, chip: Chip) -> bool:
    """Whether it is one chip, set the same way. By its factory's trim it is known on whatever bus it is."""
    there, here = kept.identity, chip.identity
    if there.fingerprint and there.is_fake == here.is_fake:
        there = msgspec.structs.replace(there, bus=here.bus, address=here.address)
    return msgspec.structs.replace(kept, identity=there) == chip


def _in_words(chip: Chip) -> str:
    one = chip.identity
    return (
        f"{one.name} at 0x{one.address:02x} on {one.bus} {one.fingerprint}, {chip.gyro_range_dps} deg/s, "
        f"{chip.accel_range_g} g"
    )
