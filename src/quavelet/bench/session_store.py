"""The session's file, beside the calibration that comes of it: what was measured, to go on from."""

from __future__ import annotations

import os
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
        if chip is not None and kept.evidence.chip != chip:
            raise CalibrationError(
                f"{self.path} is of another chip, or one set otherwise ({_in_words(kept.evidence.chip)}; this is "
                f"{_in_words(chip)}): remove it, and begin anew"
            )
        return kept.evidence

    def keep(self, evidence: Evidence) -> bool:
        """Write what is new. False where it cannot be: `failure` says why, and what was there before still is."""
        if evidence.count() == self._written:
            return not self.failure
        data = msgspec.msgpack.encode(Kept(quavelet_session=VERSION, evidence=evidence))
        beside = self.path.with_name(f"{self.path.name}.new")
        try:
            with beside.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            beside.replace(self.path)
        except OSError as error:
            with suppress(OSError):
                beside.unlink(missing_ok=True)
            self.failure = f"{self.path} cannot be written ({error.strerror}): make room, nothing measured is lost yet"
            return False
        self._written, self.failure = evidence.count(), ""
        return True

    def forget(self) -> None:
        """The session is finished: remove its file."""
        self.path.unlink(missing_ok=True)


def _in_words(chip: Chip) -> str:
    one = chip.identity
    return (
        f"{one.name} at 0x{one.address:02x} on {one.bus} {one.fingerprint}, {chip.gyro_range_dps} deg/s, "
        f"{chip.accel_range_g} g"
    )
