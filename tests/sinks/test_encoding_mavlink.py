"""MAVLink, read back by pymavlink."""

from __future__ import annotations

import struct
import sys

import numpy as np
import pytest
from hypothesis import given
from sink_messages import T_NS, message, messages

from quavelet.core.errors import SettingsError
from quavelet.core.quaternion import to_matrix
from quavelet.core.units import NS_PER_S, RAD_PER_DEG
from quavelet.sinks.encodings.mavlink import Mavlink
from quavelet.sinks.encodings.ship_axes import ship_attitude
from quavelet.sinks.message import Message


def packets(data: bytes) -> list:
    common = pytest.importorskip(
        "pymavlink.dialects.v20.common", reason="pymavlink is not installed: pip install 'quavelet[mavlink]'"
    )
    return common.MAVLink(None).parse_buffer(data) or []


@pytest.fixture
def encoding() -> Mavlink:
    pytest.importorskip("pymavlink", reason="pymavlink is not installed: pip install 'quavelet[mavlink]'")
    return Mavlink()


def by_name(encoding: Mavlink, told: Message) -> dict:
    return {packet.get_type(): packet for packet in packets(encoding.encode(told))}


def f32(value: float) -> float:
    (rounded,) = struct.unpack("<f", struct.pack("<f", value))
    return float(rounded)


@given(messages)
def test_attitude_is_read_back_and_its_quaternion_is_the_same_rotation(told):
    pytest.importorskip("pymavlink", reason="pymavlink is not installed: pip install 'quavelet[mavlink]'")
    quaternions = pytest.importorskip("pymavlink.quaternion")
    found, ship = by_name(Mavlink(), told), ship_attitude(told)
    assert ship is not None
    assert ("ATTITUDE" in found, "ATTITUDE_QUATERNION" in found) == (ship.attitude_ok, ship.attitude_ok)
    if not ship.attitude_ok:
        return
    angles, turned = found["ATTITUDE"], found["ATTITUDE_QUATERNION"]
    expected = [RAD_PER_DEG * a for a in (ship.roll_deg, ship.pitch_deg, ship.yaw_deg)]
    assert [angles.roll, angles.pitch, angles.yaw] == list(map(f32, expected))
    for packet in (angles, turned):
        assert packet.time_boot_ms == told.t_ns // 1_000_000
        assert (packet.rollspeed, packet.pitchspeed, packet.yawspeed) == tuple(map(f32, ship.rate_rad_s))
    # pymavlink's own way from angles to a rotation of the body into north, east, down.
    dcm = quaternions.Quaternion(expected).dcm
    theirs = np.array([[row.x, row.y, row.z] for row in (dcm.a, dcm.b, dcm.c)])
    assert np.allclose(to_matrix(np.array([turned.q1, turned.q2, turned.q3, turned.q4])), theirs, atol=1e-5)


def test_packets_are_numbered_one_after_the_other(encoding):
    seen = [
        packet.get_seq()
        for tenth in range(400)
        for packet in packets(encoding.encode(message(t_ns=T_NS + tenth * NS_PER_S // 10)))
    ]
    assert seen == [n % 256 for n in range(len(seen))] and len(seen) > 256


def test_the_heartbeat_comes_each_second_also_while_the_attitude_is_withheld(encoding):
    common = sys.modules["pymavlink.dialects.v20.common"]
    states = []
    for tenth in range(40):
        flags = {0: ["settling"], 1: ["gap"], 2: ["stuck"]}.get(tenth // 10, [])
        found = by_name(encoding, message(flags=flags, t_ns=tenth * NS_PER_S // 10))
        assert ("ATTITUDE" in found) == (tenth // 10 in (1, 3))
        if "HEARTBEAT" in found:
            states.append((tenth, found["HEARTBEAT"].system_status))
    calibrating, critical = common.MAV_STATE_CALIBRATING, common.MAV_STATE_CRITICAL
    assert states == [(0, calibrating), (10, critical), (20, calibrating), (30, common.MAV_STATE_ACTIVE)]


def test_there_is_a_magnetometer_only_where_yaw_has_a_north_and_it_is_healthy_where_that_is_sure(encoding):
    mag = sys.modules["pymavlink.dialects.v20.common"].MAV_SYS_STATUS_SENSOR_3D_MAG

    def told(second: int, **kinds) -> tuple[bool, bool]:
        status = by_name(encoding, message(t_ns=second * NS_PER_S, **kinds))["SYS_STATUS"]
        present, healthy = status.onboard_control_sensors_present, status.onboard_control_sensors_health
        return bool(present & mag), bool(healthy & mag)

    assert told(1) == (False, False)
    assert told(2, yaw="magnetic") == (True, True)
    assert told(3, yaw="magnetic", flags=["field_disturbed"]) == (True, False)


@pytest.mark.parametrize("more", [[], ["gap"], ["gap", "overflow", "bus_error", "gyro_clipped", "accel_clipped"]])
def test_words_longer_than_a_packet_come_in_parts_that_join(encoding, more):
    texts = [
        packet
        for packet in packets(encoding.encode(message(src="fake:tilt", flags=more)))
        if packet.get_type() == "STATUSTEXT"
    ]
    assert [text.chunk_seq for text in texts] == list(range(len(texts)))
    assert len({text.id for text in texts}) == 1 and texts[0].id > 0
    assert all(len(text.text) == 50 for text in texts[:-1]) and len(texts[-1].text) < 50
    words = "".join(text.text for text in texts)
    assert words == "fake:tilt is not a real chip; yaw relative; " + (" ".join(more) or "ok")


def test_the_time_since_boot_begins_anew_after_32_bits_and_breaks_nothing(encoding):
    assert by_name(encoding, message(t_ns=2**32 * 1_000_000 + 7_000_000))["ATTITUDE"].time_boot_ms == 7


def test_without_pymavlink_the_error_says_what_to_install(monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "pymavlink"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "pymavlink", None)
    with pytest.raises(SettingsError, match=r"pip install 'quavelet\[mavlink\]'"):
        Mavlink()
