"""NMEA 0183, read back by pynmea2."""

from __future__ import annotations

import pytest
from hypothesis import given
from sink_messages import T_NS, message, messages, offset_ns

from quavelet.core.units import NS_PER_S
from quavelet.sinks.encodings.nmea import Nmea
from quavelet.sinks.encodings.ship_axes import ship_attitude
from quavelet.sinks.message import Message

pynmea2 = pytest.importorskip("pynmea2", reason="pynmea2 is not installed: pip install pynmea2")


def sentences(told: Message, encoding: Nmea | None = None) -> dict[str, pynmea2.NMEASentence]:
    """By name, as XDR; each with a right checksum."""
    data = (encoding or Nmea(offset_ns=offset_ns)).encode(told)
    assert data.endswith(b"\r\n")
    found = {}
    for line in data.decode("ascii").removesuffix("\r\n").split("\r\n"):
        assert len(line) <= 80, "a sentence has at most 82 characters with its end"
        parsed = pynmea2.parse(line, check=True)
        found[getattr(parsed, "sentence_type", None) or "PASHR"] = parsed
    return found


@given(messages)
def test_every_sentence_of_every_message_is_read_back_to_the_last_digit_it_has(told):
    ship, found = ship_attitude(told), sentences(told)
    assert ship is not None
    assert set(found) >= {"PASHR", "ROT", "TXT"}
    if not ship.attitude_ok:
        assert "XDR" not in found and found["PASHR"].roll is None and found["PASHR"].pitch is None
    else:
        pitch, roll = (found["XDR"].get_transducer(i) for i in range(2))
        assert (pitch.type, pitch.units, pitch.id) == ("A", "D", "PITCH")
        assert (roll.type, roll.units, roll.id) == ("A", "D", "ROLL")
        assert float(pitch.value) == pytest.approx(ship.pitch_deg, abs=0.0051)
        assert float(roll.value) == pytest.approx(ship.roll_deg, abs=0.0051)
        assert (found["PASHR"].roll, found["PASHR"].pitch) == (float(roll.value), float(pitch.value))
    if ship.rate_ok:
        degrees_a_minute = ship.turn_rad_s * 57.29577951 * 60
        assert float(found["ROT"].rate_of_turn) == pytest.approx(degrees_a_minute, abs=0.051)


@given(messages)
def test_there_is_no_heading_of_any_kind_while_yaw_is_relative_or_the_heading_doubtful(told):
    ship, found = ship_attitude(told), sentences(told)
    assert ship is not None
    headings = {name for name in found if name.startswith("HD")}
    if ship.heading_deg is None:
        assert headings == set()
        assert (found["PASHR"].true_heading, found["PASHR"].is_true_heading) == (None, "")
    else:
        assert headings == {"HDM" if told.yaw == "magnetic" else "HDT"}
        heading = float(found[headings.pop()].heading)
        assert 0.0 <= heading < 360.0
        assert abs((heading - ship.heading_deg + 180) % 360 - 180) <= 0.051
        assert (found["PASHR"].is_true_heading == "T") == (told.yaw == "true")


def test_a_heading_that_rounds_up_to_north_is_0_and_not_360():
    north = message((0.70710678, 0.0, 0.0, 0.7071068), yaw="true")  # yaw a hair above 90 degrees
    found = sentences(north)
    assert (str(found["HDT"].heading), found["PASHR"].true_heading) == ("0.0", 0.0)


@pytest.mark.parametrize(("yaw", "empty"), [("relative", 4), ("magnetic", 4), ("true", 1)])
def test_a_pashr_without_a_heading_has_more_empty_fields_than_a_signal_k_server_takes(yaw, empty):
    # It reads an empty heading as 0, and gives up a PASHR of more than three empty fields.
    (pashr,) = (line for line in Nmea(offset_ns=offset_ns).encode(message(yaw=yaw)).split(b"\r\n") if b"PASHR" in line)
    assert pashr.split(b"*")[0].split(b",").count(b"") == empty


@pytest.mark.parametrize("flag", ["settling", "stuck"])
def test_an_attitude_that_may_not_be_used_leaves_its_fields_empty(flag):
    found = sentences(message(flags=[flag]))
    assert "XDR" not in found
    assert (found["PASHR"].roll, found["PASHR"].pitch, int(found["PASHR"].imu_status)) == (None, None, 0)
    assert (found["ROT"].rate_of_turn, found["ROT"].status) == ("", "V")


@pytest.mark.parametrize("flag", ["bias_unknown", "gyro_clipped"])
def test_a_rate_that_is_not_known_is_void_and_the_tilt_goes_on(flag):
    found = sentences(message(flags=[flag]))
    assert found["ROT"].status == "V" and "XDR" in found


@pytest.mark.parametrize("flag", ["gap", "uncalibrated_temperature", "accel_clipped", "bus_error"])
def test_any_flag_lowers_the_status(flag):
    assert int(sentences(message(flags=[flag]))["PASHR"].imu_status) == 0
    assert int(sentences(message())["PASHR"].imu_status) == 1


def test_the_sentences_of_a_level_board_are_these():
    encoding = Nmea(offset_ns=offset_ns)
    assert encoding.encode(message(yaw="true")).decode("ascii").split("\r\n") == [
        "$PASHR,221320.000,90.00,T,0.00,0.00,,0.500,0.500,2.000,0,1*34",
        "$IIXDR,A,0.00,D,PITCH,A,0.00,D,ROLL*15",
        "$IIROT,0.0,A*26",
        "$IIHDT,90.0,T*1B",
        "$IITXT,01,01,02,linux:1; yaw true; ok*6A",
        "",
    ]


def test_a_fake_says_so_in_words_when_it_begins_when_that_changes_and_every_ten_seconds():
    encoding, told = Nmea(offset_ns=offset_ns), []
    for tenth in range(250):
        flags = ["gap"] if tenth >= 155 else []
        found = sentences(message(src="fake:tilt", flags=flags, t_ns=T_NS + tenth * NS_PER_S // 10), encoding)
        if "TXT" in found:
            told.append((tenth, found["TXT"].text))
    ok, gap = ("fake:tilt is not a real chip; yaw relative; " + word for word in ("ok", "gap"))
    assert told == [(0, ok), (100, ok), (155, gap)]
