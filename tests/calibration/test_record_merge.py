"""Parts made anew over an older calibration: what stays keeps its date, and what does not fit does not stay."""

from __future__ import annotations

from math import inf

import msgspec
import pytest
from test_calibration_record import changed, made

from quavelet.calibration.record import CalibrationRecord, Made, MagnetometerTable
from quavelet.calibration.record_file import as_toml, from_toml
from quavelet.calibration.record_merge import accelerometer_of, merge
from quavelet.core.errors import CalibrationError

OLDER = made()


def made_anew(*parts: str, warmer_degc: float = 0.0) -> CalibrationRecord:
    """A later record of these parts alone."""
    then = OLDER.made
    now = Made(
        utc="2027-01-01T00:00:00Z",
        version="9",
        gyro_range_dps=500,
        accel_range_g=4,
        lowest_degc=then.lowest_degc + warmer_degc,
        highest_degc=then.highest_degc + warmer_degc,
    )
    gone = {part: None for part in ("accelerometer", "gyro_bias", "gyro_scale", "magnetometer") if part not in parts}
    return msgspec.structs.replace(OLDER, made=now, **gone)


def test_what_is_not_made_anew_stays_with_its_own_date_and_temperatures():
    merged = merge(made_anew("gyro_scale", warmer_degc=3.0), OLDER)
    assert (merged.fresh, merged.kept) == (("gyro_scale",), ("accelerometer", "gyro_bias"))
    record = from_toml(as_toml(merged.record))
    assert record == merged.record
    assert (record.accelerometer, record.gyro_bias) == (OLDER.accelerometer, OLDER.gyro_bias)
    assert record.made_of("accelerometer") == OLDER.made
    assert record.made_of("gyro_scale").utc == "2027-01-01T00:00:00Z"
    assert "accelerometer of 2026-01-02" in record.in_words()
    # All parts were made at those temperatures only that they have in common.
    held = record.calibration()
    assert held.lowest_degc == OLDER.made.lowest_degc + 3.0 - 5.0
    assert held.highest_degc == OLDER.made.highest_degc + 5.0


def test_a_part_kept_twice_keeps_its_first_date():
    once = merge(made_anew("gyro_scale"), OLDER).record
    twice = merge(msgspec.structs.replace(made_anew("gyro_bias"), made=OLDER.made), once).record
    assert twice.made_of("accelerometer") == OLDER.made
    assert twice.made_of("gyro_scale").utc == "2027-01-01T00:00:00Z"


def test_all_made_anew_keeps_nothing():
    merged = merge(made_anew("accelerometer", "gyro_bias", "gyro_scale"), OLDER)
    assert (merged.kept, merged.record.kept) == ((), None)


def test_only_the_part_that_is_worse_stays_as_it_was():
    new = made_anew("accelerometer", "gyro_bias", "gyro_scale")
    new = changed(new, gyro_scale={"scale_sigma": 3.0 * OLDER.gyro_scale.scale_sigma})
    merged = merge(new, OLDER)
    assert merged.kept == ("gyro_scale",)
    assert merged.worse == {"gyro_scale": "its gyro scale is 3.0 times less sure"}
    assert merge(new, OLDER, even_if_worse=True).kept == ()


def test_turns_that_show_less_than_the_older_ones_are_worse():
    new = changed(made_anew("gyro_scale"), gyro_scale={"undetermined": ("misalignment xy",)})
    assert merge(new, OLDER).worse == {"gyro_scale": "its gyro scale does not show misalignment xy"}


def test_turns_are_not_kept_beside_an_accelerometer_with_other_axes():
    by_hand = changed(OLDER, accelerometer={"frame": "sensor"})
    merged = merge(made_anew("accelerometer"), by_hand)
    assert merged.record.gyro_scale is None
    assert "take the step 'turns'" in merged.left["gyro_scale"]


def test_an_accelerometer_in_other_axes_that_is_worse_takes_its_turns_with_it():
    new = changed(made_anew("accelerometer", "gyro_scale"), accelerometer={"frame": "sensor"})
    merged = merge(new, OLDER)
    assert merged.kept == ("accelerometer", "gyro_bias", "gyro_scale")
    assert merged.fresh == ()
    assert "the sensor's" in merged.worse["accelerometer"]


def test_parts_made_at_temperatures_that_have_nothing_in_common_are_not_put_together():
    merged = merge(made_anew("gyro_scale", warmer_degc=40.0), OLDER)
    assert merged.kept == ()
    assert set(merged.left) == {"accelerometer", "gyro_bias"}
    assert "about the same temperature" in merged.left["accelerometer"]


def test_the_fit_of_a_records_accelerometer_gives_the_same_forces():
    pose_fit = accelerometer_of(OLDER.accelerometer)
    calibration = OLDER.calibration()
    assert pose_fit.offset_m_s2 == calibration.accel_offset_m_s2
    assert pose_fit.sigma[:3] * 9.80665 == pytest.approx(OLDER.accelerometer.offset_sigma_m_s2)


@pytest.mark.parametrize("line", ["lowest_degc = 900.0", "gyro_range_dps = 1"])
def test_what_no_part_can_have_been_made_at_is_refused(line):
    text = as_toml(merge(made_anew("gyro_scale"), OLDER).record)
    head, _, tail = text.partition("[kept.accelerometer]")
    key = line.split(" = ")[0]
    lines = [line if one.startswith(f"{key} =") else one for one in tail.splitlines()]
    damaged = "\n".join(one for one in f"{head}[kept.accelerometer]\n".splitlines() + lines if "digest =" not in one)
    with pytest.raises(CalibrationError, match=key):
        from_toml(damaged)


def test_a_record_of_the_magnetometer_alone_flags_no_temperature():
    iron = MagnetometerTable(
        hard_iron_ut=(1.0, 2.0, 3.0),
        hard_iron_sigma_ut=(0.1, 0.1, 0.1),
        soft_iron=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        field_ut=48.0,
        field_sigma=0.01,
        coverage=0.9,
        rms_before=0.3,
        rms_after=0.01,
    )
    alone = msgspec.structs.replace(made_anew(), magnetometer=iron)
    assert (alone.calibration().lowest_degc, alone.calibration().highest_degc) == (-inf, inf)
    beside = merge(alone, OLDER)
    assert beside.fresh == ("magnetometer",)
    assert beside.record.calibration().lowest_degc == OLDER.calibration().lowest_degc
