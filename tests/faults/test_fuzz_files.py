"""Files that people and programs write: whatever is in them, there are settings, a calibration, or the one error that
names the file. FUZZ_EXAMPLES=100000 looks for longer."""

from __future__ import annotations

import os
import re
import tempfile
import tracemalloc
from collections.abc import Callable
from math import isfinite
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quavelet.calibration.record import (
    AccelerometerTable,
    CalibrationRecord,
    ChipIdentity,
    GyroBiasTable,
    GyroScaleTable,
    KeptTable,
    Made,
    MagnetometerTable,
    OffsetsTable,
)
from quavelet.calibration.record_file import as_toml, load_record
from quavelet.core.errors import CalibrationError, ImuError, SettingsError
from quavelet.settings import load_settings
from quavelet.settings.reference import example

EXAMPLES = int(os.environ.get("FUZZ_EXAMPLES", "300"))
VALUES = [
    b"nan", b"-inf", b"1e999", b"-1e308", b"1e-320", b"-0.0", b"9" * 400, b"-" + b"9" * 5000, b"0x" + b"f" * 6000,
    b"0", b"-1", b"true", b'""', b"[]", b"{}", b"[[[]]]", b"[nan, nan, nan]", b"2026-01-01", b'"\\u0000"', b'"\\n"',
    b"'" + b"x" * 9000 + b"'", b'["", ""]', b"1_0", b"{a = 1}",
]  # fmt: skip
DEEP = [b"x = " + 5000 * b"[", b"x = " + 5000 * b"{a=", b"[" + b"a." * 5000 + b"a]", b"a." * 5000 + b"a = 1"]

VECTOR, UNIT = (0.01, -0.02, 0.03), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
SMALL = ((0.001, 0.001, 0.001),) * 3
MADE = Made(
    utc="2026-01-02T03:04:05Z", version="0.1.0", gyro_range_dps=500, accel_range_g=4, lowest_degc=10.0,
    highest_degc=40.0,
)  # fmt: skip
RECORD = CalibrationRecord(
    chip=ChipIdentity(who_am_i=0x68, name="MPU-6050", bus="linux:1", address=0x68, fingerprint="0d0e0f"),
    made=MADE,
    kept=KeptTable(gyro_scale=MADE),
    accelerometer=AccelerometerTable(
        offset_m_s2=VECTOR, offset_sigma_m_s2=(0.01, 0.01, 0.01), matrix=UNIT, matrix_sigma=SMALL, frame="faces",
        undetermined=(), sigma_m_s2=0.02, rms_before_g=0.05, rms_after_g=0.001, residual_g=(0.001, 0.002),
    ),
    gyro_bias=GyroBiasTable(
        reference_degc=25.0, coefficients_rad_s=(VECTOR, (0.001, 0.0, 0.0)), lowest_degc=10.0, highest_degc=40.0,
        sigma_rad_s=0.001, slope_sigma_rad_s_degc=0.0001, per_force_rad_s=SMALL, residual_rms_rad_s=0.001,
    ),
    gyro_scale=GyroScaleTable(
        matrix=UNIT, matrix_sigma=SMALL, undetermined=(), scale_sigma=0.001, residual_deg=((0.1, 0.2, 0.3),)
    ),
    magnetometer=MagnetometerTable(
        hard_iron_ut=(10.0, -5.0, 3.0), hard_iron_sigma_ut=(0.5, 0.5, 0.5), soft_iron=UNIT, field_ut=48.0,
        field_sigma=0.01, coverage=0.9, rms_before=0.2, rms_after=0.01,
    ),
    offsets=OffsetsTable(accel_factory=(1, 2, 3), gyro_factory=(4, 5, 6), accel=(7, 8, 9), gyro=(10, 11, 12)),
)  # fmt: skip
OUTPUTS = b'[output.a]\nto = "mqtts:h:1"\n[output.a.mqtt]\nqos = 1\n[output.b]\nto = "unix:/x"\nrate_hz = 1.0\n'
GOOD = {
    "settings": re.sub(rb"(?m)^#.*\n", b"", example().encode()) + OUTPUTS,
    # Without its digest: with it hardly a change would come through.
    "calibration": re.sub(rb"(?m)^(#|digest).*\n", b"", as_toml(RECORD).encode()),
}
LOAD: dict[str, Callable[[Path], object]] = {
    "settings": lambda path: load_settings(path).settings,
    "calibration": lambda path: load_record(path).calibration(),
}
ERROR: dict[str, type[ImuError]] = {"settings": SettingsError, "calibration": CalibrationError}


@st.composite
def spoilt(draw: st.DrawFn, good: bytes) -> bytes:
    """The good file with some of it changed: a value, a line, or bytes anywhere."""
    lines = good.split(b"\n")
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(lines) - 1))
        key = lines[at].partition(b" = ")[0]
        match draw(st.sampled_from(["value", "value", "value", "drop", "twice", "bytes", "move", "key"])):
            case "value" if b" = " in lines[at]:
                lines[at] = key + b" = " + draw(st.sampled_from(VALUES) | st.floats().map(lambda x: repr(x).encode()))
            case "drop":
                lines[at] = b""
            case "twice":
                lines.insert(at, lines[at])
            case "move":
                lines.insert(draw(st.integers(0, len(lines) - 1)), lines[at])
            case "key":
                lines.insert(at, draw(st.binary(max_size=12)) + b" = " + draw(st.sampled_from(VALUES)))
            case _:
                cut = draw(st.integers(0, len(lines[at])))
                lines[at] = lines[at][:cut] + draw(st.binary(max_size=8)) + lines[at][cut + draw(st.integers(0, 4)) :]
    return b"\n".join(lines)


def load(kind: str, content: bytes) -> object | None:
    """What is loaded, None where it was refused as it should be."""
    with tempfile.NamedTemporaryFile(suffix=".toml") as file:
        file.write(content)
        file.flush()
        try:
            return LOAD[kind](Path(file.name))
        except ERROR[kind] as error:
            for line in str(error).splitlines():
                assert line.startswith(f"{file.name}: ")
                assert line.isprintable()
                assert len(line) < 2000
            return None


@pytest.mark.parametrize("kind", GOOD)
def test_a_good_file_is_loaded(kind: str) -> None:
    assert load(kind, GOOD[kind]) is not None


@settings(max_examples=EXAMPLES, deadline=None)
@given(data=st.data())
@pytest.mark.parametrize("kind", GOOD)
def test_a_spoilt_file_is_refused_by_name_or_holds_numbers_only(kind: str, data: st.DataObject) -> None:
    loaded = load(kind, data.draw(spoilt(GOOD[kind])))
    for number in numbers_in(loaded):
        assert isfinite(number)
        assert abs(number) < 1e12


@settings(max_examples=EXAMPLES, deadline=None)
@given(
    content=st.binary(max_size=2000) | st.text(max_size=1000).map(lambda text: text.encode("utf-8", "surrogatepass"))
)
@pytest.mark.parametrize("kind", GOOD)
def test_a_file_of_anything_is_refused_by_name(kind: str, content: bytes) -> None:
    assert kind == "settings" or load(kind, content) is None
    load(kind, content)


@pytest.mark.parametrize("kind", GOOD)
@pytest.mark.parametrize("content", DEEP, ids=lambda content: content[:8].decode())
def test_a_file_that_is_nested_without_end_is_refused_by_name(kind: str, content: bytes) -> None:
    assert load(kind, content) is None
    assert load(kind, GOOD[kind] + b"\n[deep]\n" + content) is None


@pytest.mark.parametrize("kind", GOOD)
def test_every_value_is_tried_with_all_that_cannot_be(kind: str) -> None:
    lines = GOOD[kind].split(b"\n")
    for at, line in enumerate(lines):
        key, equals, _ = line.partition(b" = ")
        for value in VALUES if equals else ():
            changed = [*lines[:at], key + equals + value, *lines[at + 1 :]]
            for number in numbers_in(load(kind, b"\n".join(changed))):
                assert isfinite(number)


@pytest.mark.parametrize("kind", GOOD)
def test_a_file_without_end_is_not_read_to_it(kind: str) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(ERROR[kind], match="/dev/zero: "):
            LOAD[kind](Path("/dev/zero"))
        assert tracemalloc.get_traced_memory()[1] < 20_000_000
    finally:
        tracemalloc.stop()


def numbers_in(loaded: object) -> list[float]:
    """Every number of it; infinite is how far a calibration without a temperature reaches."""
    if isinstance(loaded, float | int) and not isinstance(loaded, bool):
        return [float(loaded)]
    if isinstance(loaded, list | tuple):
        return [number for item in loaded for number in numbers_in(item)]
    if isinstance(loaded, dict):
        return numbers_in(list(loaded.values()))
    if isinstance(loaded, msgspec.Struct) or hasattr(loaded, "__dataclass_fields__"):
        return numbers_in(msgspec.structs.asdict(loaded) if isinstance(loaded, msgspec.Struct) else _fields(loaded))
    return []


def _fields(loaded: object) -> dict[str, object]:
    names = [name for name in loaded.__dataclass_fields__ if name not in ("lowest_degc", "highest_degc")]
    return {name: getattr(loaded, name) for name in names}
