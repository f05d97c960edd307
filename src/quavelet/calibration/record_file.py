"""A calibration's file: TOML that a person can read, checked as a whole, written as a whole or not at all.

The digest is over all values, not over comments or spacing. A file whose values do not agree with it is refused:
it is damaged, or was changed by hand. Whoever means to change one deletes the digest's line; the limits of what a chip
can have hold all the same.
"""

from __future__ import annotations

import os
import re
import tempfile
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

import msgspec

from quavelet.calibration.limits import check_finite, check_sane
from quavelet.calibration.record import CalibrationRecord, ChipIdentity, reasons_worse
from quavelet.core.errors import CalibrationError
from quavelet.core.toml import parse_toml, read_text

FORMAT = 1
ROOM_BYTES = 65536
"""A file is some KiB: so much is written to see whether there is room."""
_HEX = ("who_am_i", "address")
SYSTEM_FOLDER = Path("/etc/quavelet/calibration")


def as_toml(record: CalibrationRecord) -> str:
    """The file's text. Raises CalibrationError for a value that would be refused on loading."""
    tables = {name: _given(table) for name, table in _builtins(record).items() if table is not None}
    check_finite(tables)
    check_sane(tables)
    body = "\n".join(_table(name, table) for name, table in tables.items())
    digest = digest_of(tomllib.loads(body))
    head = "# A calibration of quavelet; each value has its unit in its name."
    return f'{head}\nformat = {FORMAT}\ndigest = "{digest}"\n{body}\n'


def from_toml(text: str) -> CalibrationRecord:
    """The record of a file's text. Raises CalibrationError that names the key, or says what else is wrong."""
    try:
        tables = parse_toml(text)
    except ValueError as error:
        raise CalibrationError(f"it is not TOML ({error}): calibrate anew") from error
    if tables.pop("format", None) != FORMAT:
        raise CalibrationError(f"it is no calibration of format {FORMAT}: calibrate anew with this version")
    check_finite(tables)
    digest = tables.pop("digest", None)
    if digest is not None and digest != digest_of(tables):
        raise CalibrationError(
            "its values do not agree with its digest: it is damaged, or was changed by hand; calibrate anew, or delete "
            "the line of the digest if the change is meant"
        )
    try:
        record = msgspec.convert(tables, CalibrationRecord)
    except msgspec.ValidationError as error:
        what, _, place = str(error).partition(" - at `$.")
        raise CalibrationError(f"{place.rstrip('`') or 'the file'}: {what}: calibrate anew") from error
    check_sane(tables)
    return record


def load_record(path: Path) -> CalibrationRecord:
    """The record in a file. Raises CalibrationError that begins with the path."""
    try:
        return from_toml(read_text(path))
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from error
    except ValueError as error:
        raise CalibrationError(f"{path}: it is not TOML ({error}): calibrate anew") from error
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read ({error.strerror}): give the path of a calibration") from error


def check_same_chip(path: Path, chip: ChipIdentity) -> None:
    """Raises CalibrationError where the file holds another chip's calibration, which is not to be lost."""
    try:
        there = load_record(path).chip if path.exists() else chip
    except CalibrationError:
        return  # What cannot be used is no loss.
    if there.fingerprint != chip.fingerprint or there.who_am_i != chip.who_am_i:
        raise CalibrationError(f"{path}: is the calibration of another chip: give another place with --out")


def save_record(record: CalibrationRecord, path: Path, *, even_if_worse: bool = False) -> None:
    """Put the record in place of what is there, as a whole: after a crash there is the old file or the new one.

    Raises CalibrationError where what is there is a better calibration of the same chip and `even_if_worse` was not
    asked for, or where it cannot be written.
    """
    text = as_toml(record)
    if not even_if_worse:
        _refuse_worse(record, path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _replace(path, text.encode())
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be written ({error.strerror}): {_REMEDY}") from error


_REMEDY = "give another place with --out, or make room or permission there"


def check_writable(path: Path) -> None:
    """Whether a calibration could be saved there, found out by trying, before anything is measured.

    Makes the folder, leaves no file. Raises CalibrationError.
    """
    if path.is_dir():
        raise CalibrationError(f"{path}: is a folder: give the path of a file")
    if path.exists() and not path.is_file():
        raise CalibrationError(f"{path}: is a device or a pipe, which would be replaced: give the path of a file")
    if path.exists() and not os.access(path, os.W_OK):
        raise CalibrationError(f"{path}: may not be written: {_REMEDY}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        trial = _written(path, bytes(ROOM_BYTES))
        trial.unlink()
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be written ({error.strerror}): {_REMEDY}") from error


def digest_of(tables: Mapping[str, object]) -> str:
    """Of all values, whatever their order."""
    canonical = msgspec.json.encode(tables, order="deterministic")
    return f"sha256:{sha256(canonical).hexdigest()}"


def file_name(chip: ChipIdentity) -> str:
    """The name that a chip's calibration is found by."""
    which = chip.fingerprint or f"{chip.bus}-0x{chip.address:02x}"
    fake = "fake-" if chip.is_fake else ""
    return re.sub(r"[^a-z0-9-]+", "-", f"{fake}{chip.name}-{which}".lower()) + ".toml"


def folders(environment: Mapping[str, str] | None = None) -> tuple[Path, ...]:
    """Where calibrations are looked for, in this order: the user's, the system's."""
    environment = os.environ if environment is None else environment
    home = environment.get("XDG_CONFIG_HOME") or (f"{environment['HOME']}/.config" if environment.get("HOME") else None)
    return (*((Path(home) / "quavelet" / "calibration",) if home else ()), SYSTEM_FOLDER)


def default_path(chip: ChipIdentity, environment: Mapping[str, str] | None = None) -> Path:
    """Where a chip's calibration is saved unless told otherwise: the system's folder for root, who runs services."""
    return (SYSTEM_FOLDER if os.geteuid() == 0 else folders(environment)[0]) / file_name(chip)


def any_records(environment: Mapping[str, str] | None = None) -> bool:
    """Whether there is any calibration to be looked for: if not, the chip need not be asked who it is."""
    for folder in folders(environment):
        with suppress(OSError):
            if any(folder.glob("*.toml")):
                return True
    return False


def find_record(chip: ChipIdentity, environment: Mapping[str, str] | None = None) -> Path | None:
    """The file of this chip's calibration, None where there is none."""
    for folder in folders(environment):
        path = folder / file_name(chip)
        if path.is_file():
            return path
    return None


def _refuse_worse(record: CalibrationRecord, path: Path) -> None:
    check_same_chip(path, record.chip)
    try:
        old = load_record(path) if path.exists() else None
    except CalibrationError:
        return  # What cannot be used is not better.
    if old is None:
        return
    reasons = reasons_worse(record, than=old)
    if reasons:
        raise CalibrationError(
            f"{path}: the calibration there, of {old.made.utc}, is better; of the new one: {', '.join(reasons)}"
        )


def _replace(path: Path, content: bytes) -> None:
    trial = _written(path, content)
    try:
        trial.replace(path)
    except OSError:
        trial.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _written(path: Path, content: bytes) -> Path:
    """A new file beside `path`, on the disk; none is left where that fails."""
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    trial = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        # The service, another user, reads it.
        trial.chmod(0o644)
    except OSError:
        trial.unlink(missing_ok=True)
        raise
    return trial


def _builtins(record: CalibrationRecord) -> dict[str, dict[str, object] | None]:
    return msgspec.json.decode(msgspec.json.encode(record), type=dict[str, dict[str, object] | None])


def _given(table: dict[str, object]) -> dict[str, object]:
    return {key: value for key, value in table.items() if value is not None}


def _table(name: str, table: Mapping[str, object]) -> str:
    """A table, and after it those that stand in it."""
    inner = {key: value for key, value in table.items() if isinstance(value, dict)}
    lines = [_line(key, value) for key, value in table.items() if key not in inner]
    return "\n".join([f"\n[{name}]", *lines, *(_table(f"{name}.{key}", value) for key, value in inner.items())])


def _line(key: str, value: object) -> str:
    # A TOML value of these types (text, numbers, lists) is written as in JSON, but for DEL.
    if key in _HEX and isinstance(value, int):
        return f"{key} = 0x{value:02x}"
    return f"{key} = " + msgspec.json.encode(value).decode().replace("\x7f", "\\u007f")
