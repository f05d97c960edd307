"""What holds for every encoding there is."""

from __future__ import annotations

import json
import re
import struct
import time
from typing import get_args

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sink_messages import FLAGS, T_NS, broken_messages, message, messages

from quavelet.core.clock import VirtualClock
from quavelet.core.errors import SettingsError
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.imu import open_imu
from quavelet.settings import OutputSettings
from quavelet.settings.outputs import EncodingName
from quavelet.sinks.encoding import Encoding
from quavelet.sinks.encodings.json import Json
from quavelet.sinks.message import Message
from quavelet.sinks.outputs import ENCODINGS, make_encoding
from quavelet.sinks.plan import OutputPlan

TEXT = ["json", "nmea", "signalk", "influx"]


def made(name: str) -> Encoding:
    def status():
        raise AssertionError("no encoding asks for the status")

    settings = OutputSettings(to="udp:127.0.0.1:5555", encoding=name)
    plan = OutputPlan(name="out", settings=settings, service="imu0", status=status, offset_ns=int)
    try:
        return make_encoding(plan)
    except SettingsError as error:
        pytest.skip(str(error))


def test_every_encoding_of_the_settings_is_there():
    assert set(ENCODINGS) == set(get_args(EncodingName))


@pytest.mark.parametrize("name", ["nmea", "signalk", "opentrack", "mavlink"])
@given(told=broken_messages())
def test_a_message_with_an_angle_or_a_rate_that_is_no_number_is_withheld(name, told):
    data = made(name).encode(told)
    whole = all(
        value == value and abs(value) != float("inf")
        for value in (told.roll_deg, told.pitch_deg, told.yaw_deg, *told.q, *told.gyro_rad_s)
    )
    assert whole or data == b""


@pytest.mark.parametrize("name", TEXT)
@given(told=st.one_of(messages, broken_messages()))
def test_no_text_has_a_number_that_is_none_or_a_line_that_does_not_end(name, told):
    data = made(name).encode(msgspec.structs.replace(told, src="linux:1")).decode("utf-8")
    assert data == "" or data.endswith("\n")
    assert re.search(r"\b(nan|inf|infinity)\b", data, re.IGNORECASE) is None


@given(messages)
def test_json_is_read_back_as_the_same_message(told):
    data = Json().encode(told)
    assert data.count(b"\n") == 1 and data.endswith(b"\n")
    read = json.loads(data)
    assert Message(**{k: tuple(v) if isinstance(v, list) and k != "flags" else v for k, v in read.items()}) == told


@given(broken_messages())
def test_what_is_no_number_is_null_in_json(told):
    def fail(word: str) -> float:
        raise AssertionError(f"{word} went out")

    assert "null" in json.dumps(json.loads(Json().encode(told), parse_constant=fail))


@pytest.mark.parametrize("name", sorted(ENCODINGS))
def test_a_stuck_chip_does_not_look_like_a_healthy_one(name):
    encoding = made(name)
    assert encoding.encode(message(flags=["stuck"])) != encoding.encode(message())


def test_a_fake_chip_is_withheld_until_it_has_settled_and_then_has_its_tilt_in_every_encoding():
    clock = VirtualClock()
    encodings = {name: made(name) for name in ("nmea", "signalk", "influx", "opentrack")}
    sent: dict[str, list[bytes]] = {name: [] for name in encodings}
    last = None
    with open_imu("fake:tilt", clock=clock) as imu:
        for last in imu.messages(until_ns=4 * NS_PER_S):
            settling = "settling" in last.flags
            for name, encoding in encodings.items():
                sent[name].append(encoding.encode(last))
            assert (sent["opentrack"][-1] == b"") == settling
            assert (b"XDR" in sent["nmea"][-1]) == (not settling)
            assert (b'"navigation.attitude","value":null' in sent["signalk"][-1]) == settling
            assert (b"settling" in sent["influx"][-1]) == settling
    assert last is not None and not last.flags
    assert b"" in sent["opentrack"]
    roll_deg = struct.unpack("<6d", sent["opentrack"][-1])[5]
    assert roll_deg == last.roll_deg
    assert f",A,{roll_deg:.2f},D,ROLL*".encode() in sent["nmea"][-1]
    assert not any(b"HDM" in one or b"HDT" in one for one in sent["nmea"])
    assert b"src=fake:tilt,yaw=relative " in sent["influx"][-1]


@pytest.mark.benchmark
@pytest.mark.parametrize("name", sorted(ENCODINGS))
def test_any_message_fits_one_datagram_and_the_cost_is_this(name):
    encoding = made(name)
    worst = message((0.3, -0.4, 0.5, -0.6), yaw="magnetic", flags=FLAGS, gyro_rad_s=(-34.9, 34.9, -34.9), src="x" * 60)
    assert len(encoding.encode(worst)) <= 1400
    told = [message((1.0, 0.01 * (i % 7), 0.1, 0.2), yaw="true", t_ns=T_NS + 5 * NS_PER_MS * i) for i in range(1000)]
    began_ns = time.perf_counter_ns()
    size = sum(len(encoding.encode(one)) for one in told)
    cost_us = (time.perf_counter_ns() - began_ns) / 1e3 / len(told)
    print(f"{name}: {cost_us:.1f} us and {size / len(told):.0f} bytes a message")
