"""The calibration's file: what comes back, what is refused, and that there is never half of one."""

from __future__ import annotations

import errno
import os
import tomllib
from functools import cache
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated_boards import calibrated_board

from quavelet.calibration import record_file
from quavelet.calibration.record import (
    CalibrationRecord,
    ChipIdentity,
    Made,
    OffsetsTable,
    accelerometer_table,
    gyro_bias_table,
    gyro_scale_table,
    is_better,
    reasons_worse,
)
from quavelet.calibration.record_file import (
    as_toml,
    check_writable,
    default_path,
    digest_of,
    file_name,
    find_record,
    from_toml,
    load_record,
    save_record,
)
from quavelet.core.errors import CalibrationError

CHIP = ChipIdentity(who_am_i=0x68, name="MPU-6050", bus="linux:1", address=0x68, fingerprint="0d0e0f-0102")


@cache
def made() -> CalibrationRecord:
    c = calibrated_board(1, poses=12)
    return CalibrationRecord(
        chip=CHIP,
        made=Made(
            utc="2026-01-02T03:04:05Z", version="0.1.0", gyro_range_dps=500, accel_range_g=4,
            lowest_degc=c.bias.lowest_degc, highest_degc=c.bias.highest_degc,
        ),
        accelerometer=accelerometer_table(c.accel),
        gyro_bias=gyro_bias_table(c.bias),
        gyro_scale=gyro_scale_table(c.turns),
    )  # fmt: skip


def changed(record: CalibrationRecord, **tables) -> CalibrationRecord:
    """The record with other values in its tables."""
    return msgspec.structs.replace(
        record,
        **{name: msgspec.structs.replace(getattr(record, name), **values) for name, values in tables.items()},
    )


def names(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


def without_digest(text: str) -> str:
    return "\n".join(line for line in text.splitlines() if not line.startswith("digest"))


def test_a_record_comes_back_to_the_bit(tmp_path):
    path = tmp_path / "deep" / "chip.toml"
    save_record(made(), path)
    assert load_record(path) == made()
    assert path.stat().st_mode & 0o777 == 0o644
    assert names(path.parent) == ["chip.toml"]


def test_comments_and_spacing_may_change_but_no_value():
    text = as_toml(made())
    assert from_toml("# mine\n" + text.replace(" = ", "   =  ")) == made()
    with pytest.raises(CalibrationError, match="digest"):
        from_toml(text.replace("500", "250"))
    by_hand = from_toml(without_digest(text).replace("gyro_range_dps = 500", "gyro_range_dps = 250"))
    assert by_hand.made.gyro_range_dps == 250


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_one_damaged_character_is_never_taken_for_another_calibration(data):
    text = as_toml(made())
    at = data.draw(st.integers(0, len(text) - 1))
    letter = data.draw(st.sampled_from('0123456789.-eE=[]," \nxn'))
    damaged = text[:at] + letter + text[at + 1 :]
    try:
        assert from_toml(damaged) == made()
    except CalibrationError:
        return


@pytest.mark.parametrize("word", ["nan", "inf", "-inf", "1e999"])
@pytest.mark.parametrize(
    "key", ["accelerometer.offset_m_s2", "gyro_bias.coefficients_rad_s", "gyro_scale.matrix", "made.lowest_degc"]
)
def test_what_is_no_number_is_refused_and_its_key_named(key, word):
    table, name = key.split(".")
    lines = without_digest(as_toml(made())).splitlines()
    begin = lines.index(f"[{table}]")
    at = next(k for k in range(begin, len(lines)) if lines[k].startswith(f"{name} = "))
    value = lines[at].split(" = ")[1]
    number = value.strip("[]").split(",")[0]
    lines[at] = lines[at].replace(number, word, 1)
    with pytest.raises(CalibrationError, match=f"^{key} = .*finite"):
        from_toml("\n".join(lines))


@pytest.mark.parametrize(
    ("table", "field", "value"),
    [
        ("accelerometer", "offset_m_s2", (6.0, 0.0, 0.0)),
        ("accelerometer", "matrix", ((1.5, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))),
        ("accelerometer", "matrix", ((1.0, 0.0, 0.0), (0.3, 1.0, 0.0), (0.0, 0.0, 1.0))),
        ("accelerometer", "sigma_m_s2", 0.0),
        ("gyro_bias", "coefficients_rad_s", ((2.0, 0.0, 0.0),)),
        ("gyro_bias", "coefficients_rad_s", ()),
        ("gyro_bias", "per_force_rad_s", ((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))),
        ("gyro_bias", "sigma_rad_s", -1.0),
        ("gyro_scale", "matrix", ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))),
        ("gyro_scale", "scale_sigma", 1e-300),
        ("made", "highest_degc", 1e9),
        ("chip", "who_am_i", 300),
    ],
)
def test_an_absurd_value_is_refused_and_its_key_named(table, field, value):
    wrong = changed(made(), **{table: {field: value}})
    with pytest.raises(CalibrationError, match=rf"^{table}\.{field}"):
        as_toml(wrong)
    tables = tomllib.loads(without_digest(as_toml(made())))
    tables[table][field] = msgspec.json.decode(msgspec.json.encode(value))
    body = "\n".join(
        f"[{name}]\n" + "\n".join(f"{k} = {msgspec.json.encode(v).decode()}" for k, v in t.items())
        for name, t in tables.items()
        if name != "format"
    )
    with pytest.raises(CalibrationError, match=rf"^{table}\.{field}"):
        from_toml(f"format = 1\n{body}")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("sigma_m_s2", "sigma_ms2", "accelerometer.*unknown field"),
        ("[gyro_scale]", "[gyro_scales]", "unknown field"),
        ("format = 1", "format = 2", "format 1"),
        ('utc = "', "utc = ", "not TOML"),
        ("address = 0x68", 'address = "0x68"', "chip.address"),
    ],
)
def test_a_file_of_another_shape_is_refused_with_the_place(old, new, message):
    with pytest.raises(CalibrationError, match=message):
        from_toml(without_digest(as_toml(made())).replace(old, new, 1))


WRITTEN = OffsetsTable(accel_factory=(1, 3, 5), gyro_factory=(0, 0, 0), accel=(1, 3, 5), gyro=(7, 0, 0))
FITS = {"gyro_range_dps": 500, "accel_range_g": 4}


@pytest.mark.parametrize(
    ("chip", "setting", "message"),
    [
        ({"who_am_i": 0x70}, {}, "WHO_AM_I 0x68, this one has 0x70"),
        ({"fingerprint": "another"}, {}, "another chip of the same kind"),
        ({"bus": "fake:bench"}, {}, "fake chip is not a real one"),
        ({"fingerprint": "", "address": 0x69}, {}, "0x69"),
        ({"fingerprint": "", "bus": "linux:3"}, {}, "linux:3"),
        ({}, {"gyro_range_dps": 250}, "250 deg/s"),
        ({}, {"accel_range_g": 16}, "16 g"),
        ({}, {"offsets": WRITTEN}, "offset registers"),
    ],
)  # fmt: skip
def test_the_calibration_of_another_chip_or_setting_is_refused_with_the_reason(chip, setting, message):
    with pytest.raises(CalibrationError, match=message):
        made().check_fits(msgspec.structs.replace(CHIP, **chip), **{**FITS, **setting})


def test_a_chip_is_known_again_on_another_bus_by_its_trim():
    made().check_fits(msgspec.structs.replace(CHIP, bus="linux:5", address=0x69), **FITS)


def test_a_calibration_that_has_less_or_is_less_sure_is_not_better():
    record = made()
    assert is_better(record, than=record)
    assert reasons_worse(msgspec.structs.replace(record, gyro_scale=None), than=record) == ("it has no gyro scale",)
    vaguer = changed(record, accelerometer={"sigma_m_s2": 2 * record.accelerometer.sigma_m_s2})
    assert reasons_worse(vaguer, than=record) == ("its accelerometer is 2.0 times less sure",)
    assert is_better(record, than=vaguer)
    wide = changed(record, gyro_bias={"lowest_degc": 10.0, "highest_degc": 40.0})
    assert any("degC" in reason for reason in reasons_worse(record, than=wide))
    assert is_better(wide, than=record)


def test_a_better_calibration_is_not_overwritten_unasked(tmp_path):
    path = tmp_path / "chip.toml"
    save_record(made(), path)
    less = msgspec.structs.replace(made(), gyro_scale=None)
    with pytest.raises(CalibrationError, match="is better; of the new one: it has no gyro scale"):
        save_record(less, path)
    assert load_record(path) == made()
    save_record(less, path, even_if_worse=True)
    assert load_record(path) == less


def test_the_calibration_of_another_chip_is_not_overwritten(tmp_path):
    path = tmp_path / "chip.toml"
    save_record(made(), path)
    with pytest.raises(CalibrationError, match="another chip"):
        save_record(changed(made(), chip={"fingerprint": "another"}), path)
    path.write_text("nothing of use")
    save_record(made(), path)
    assert load_record(path) == made()


@pytest.mark.parametrize("what", ["write", "fsync", "replace"])
def test_a_disk_that_is_full_leaves_the_old_file_and_no_other(tmp_path, monkeypatch, what):
    path = tmp_path / "chip.toml"
    save_record(made(), path)
    before = path.read_bytes()

    def full(*_args, **_kwargs):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    if what == "replace":
        monkeypatch.setattr(Path, "replace", full)
    elif what == "fsync":
        monkeypatch.setattr(os, "fsync", full)
    else:
        monkeypatch.setattr(record_file.os, "fdopen", full)
    with pytest.raises(CalibrationError, match="cannot be written"):
        save_record(changed(made(), accelerometer={"sigma_m_s2": 0.001}), path)
    monkeypatch.undo()
    assert path.read_bytes() == before
    assert names(tmp_path) == ["chip.toml"]


def test_whether_it_can_be_written_is_found_out_before_and_leaves_nothing(tmp_path):
    check_writable(tmp_path / "new" / "chip.toml")
    assert names(tmp_path / "new") == []
    with pytest.raises(CalibrationError, match="is a folder"):
        check_writable(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(CalibrationError, match="cannot be written"):
        check_writable(tmp_path / "file" / "chip.toml")
    with pytest.raises(CalibrationError, match="cannot be written"):
        check_writable(Path("/dev/full/chip.toml"))


def test_a_chips_file_is_found_by_its_trim_in_the_users_folder(tmp_path):
    environment = {"XDG_CONFIG_HOME": str(tmp_path)}
    assert find_record(CHIP, environment) is None
    path = tmp_path / "quavelet" / "calibration" / file_name(CHIP)
    save_record(made(), path)
    assert find_record(CHIP, environment) == path
    assert find_record(msgspec.structs.replace(CHIP, fingerprint="another"), environment) is None
    assert find_record(msgspec.structs.replace(CHIP, bus="fake:bench"), environment) is None
    assert default_path(CHIP, environment).name == file_name(CHIP)
    assert "/" not in file_name(msgspec.structs.replace(CHIP, fingerprint="", bus="fake:counts:../x"))


def test_a_record_says_what_the_pipeline_takes():
    calibration = made().calibration()
    assert calibration.accel_offset_m_s2 == made().accelerometer.offset_m_s2
    assert not calibration.knows_bias  # over less than 5 degC
    assert calibration.gyro_bias_sigma_rad_s_degc > 1e-3
    assert calibration.accel_sigma_m_s2 < 0.004 * 9.81
    wide = changed(made(), gyro_bias={"lowest_degc": 10.0, "highest_degc": 40.0, "slope_sigma_rad_s_degc": 1e-5})
    known = wide.calibration()
    assert known.knows_bias
    assert known.gyro_bias_sigma_rad_s_degc == 1e-5
    assert known.gyro_bias_sigma_rad_s == wide.gyro_bias.sigma_rad_s
    assert np.isclose(known.highest_degc, made().made.highest_degc + 5.0)


def test_the_order_of_the_keys_is_not_a_value():
    assert digest_of({"a": {"x": 1.0, "y": [1, 2]}, "b": {}}) == digest_of({"b": {}, "a": {"y": [1, 2], "x": 1.0}})
    assert digest_of({"a": {"x": 1.0}}) != digest_of({"a": {"x": 1.0000000000000002}})
