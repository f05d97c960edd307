"""InfluxDB's line protocol, read back by a parser written from its reference."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from sink_messages import T_NS, broken_messages, message, messages, offset_ns

from quavelet.sinks.encodings.influx import Influx
from quavelet.sinks.message import Message

Point = tuple[str, dict[str, str], dict[str, float | int | bool | str], int]


def parse(line: str) -> Point:
    """`measurement,tag=value field=value,field=value time`; fails on all that the reference does not allow."""
    assert line.endswith("\n") and line.count("\n") == 1
    head, at = _until(line, 0, " ")
    measurement, *pairs = _split(head, ",")
    tags = dict(_pair(pair) for pair in pairs)
    body, at = _until(line, at + 1, " ", quotes=True)
    fields = {_pair(pair)[0]: _value(_pair(pair)[1]) for pair in _split(body, ",", quotes=True)}
    assert all(tags.values()) and fields and list(tags) == sorted(tags)
    return measurement, tags, fields, int(line[at + 1 : -1])


def _until(text: str, at: int, end: str, *, quotes: bool = False) -> tuple[str, int]:
    """The text up to an `end` that is neither escaped nor in quotes, escapes kept, and where it stands."""
    begin, quoted = at, False
    while at < len(text) and (quoted or text[at] != end):
        if text[at] == "\\":
            at += 1
        elif text[at] == '"' and quotes:
            quoted = not quoted
        at += 1
    return text[begin:at], at


def _split(text: str, at: str, *, quotes: bool = False) -> list[str]:
    parts, place = [], 0
    while place <= len(text):
        part, place = _until(text, place, at, quotes=quotes)
        parts.append(part)
        place += 1
    return parts


def _pair(text: str) -> tuple[str, str]:
    key, at = _until(text, 0, "=")
    value = text[at + 1 :]
    return key, value if value.startswith('"') else _unescaped(value)


def _unescaped(text: str) -> str:
    for c in ",= ":
        text = text.replace("\\" + c, c)
    assert "\\" not in text
    return text


def _value(text: str) -> float | int | bool | str:
    if text.startswith('"'):
        assert text.endswith('"') and len(text) > 1
        return text[1:-1].replace('\\"', '"').replace("\\\\", "\\")
    if text in ("true", "false"):
        return text == "true"
    return int(text[:-1]) if text.endswith("i") else float(text)


def point(told: Message, name: str = "imu0") -> Point:
    return parse(Influx(name=name, offset_ns=offset_ns).encode(told).decode("utf-8"))


def readable(text: str) -> str:
    return "".join(c if c.isprintable() else "_" for c in text).replace("\\", "/")


@given(messages)
def test_a_message_is_read_back_with_all_its_numbers(told):
    measurement, tags, fields, t_ns = point(told)
    assert measurement == "attitude"
    assert t_ns == told.t_ns + offset_ns()
    assert tags == {k: v for k, v in {"name": "imu0", "src": readable(told.src), "yaw": told.yaw}.items() if v}
    assert [fields[f"{angle}_deg"] for angle in ("roll", "pitch", "yaw")] == [
        told.roll_deg, told.pitch_deg, told.yaw_deg,
    ]  # fmt: skip
    assert tuple(fields[f"q_{c}"] for c in "wxyz") == told.q
    assert tuple(fields[f"gyro_{c}_rad_s"] for c in "xyz") == told.gyro_rad_s
    assert tuple(fields[f"sigma_{c}_deg"] for c in "xyz") == told.sigma_deg
    assert (fields["flags"], fields["doubtful"]) == (",".join(told.flags), bool(told.flags))
    assert fields["gap_ns"] == told.gap_ns and isinstance(fields["gap_ns"], int)


@example("a\\", "b\\", ["\\", '"\\"', "\\n"])
@given(st.text(), st.text(), st.lists(st.text(min_size=1), max_size=3))
def test_no_name_can_add_a_tag_a_field_or_a_line(name, src, flags):
    _, tags, fields, t_ns = point(message(src=src, flags=flags), name=name)
    assert set(tags) <= {"name", "src", "yaw"}
    assert len(fields) == 25 and t_ns == T_NS + offset_ns()
    assert fields["flags"] == "".join(c if c.isprintable() else "_" for c in ",".join(flags))
    assert tags.get("src", "") == readable(src) and tags.get("name", "") == readable(name)


def test_a_name_that_ends_in_a_backslash_does_not_swallow_the_next_tag():
    _, tags, _, _ = point(message(src="a\\"), name="b\\")
    assert tags == {"name": "b/", "src": "a/", "yaw": "relative"}


@given(broken_messages())
def test_what_is_no_number_is_left_out_and_the_rest_stays(told):
    _, _, fields, _ = point(told)
    assert len(fields) == 24
    assert all(value == value and abs(value) != float("inf") for value in fields.values() if isinstance(value, float))


@pytest.mark.parametrize("flag", ["settling", "gap", "stuck", "uncalibrated_temperature"])
def test_doubt_is_a_field_that_can_be_asked_for(flag):
    _, _, fields, _ = point(message(flags=[flag]))
    assert (fields["doubtful"], fields["flags"]) == (True, flag)
