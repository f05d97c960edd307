"""Who publishes: ids that hold over restarts, and names that cannot reach into another's topics."""

from __future__ import annotations

import re
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
from output_plans import STATUS, mqtt_plan

from quavelet.sinks.identity import client_id_of, device_id, identity_of, topic_of


def test_the_id_holds_over_restarts_and_tells_chips_machines_and_buses_apart(tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    one.write_text("0123456789abcdef0123456789abcdef\n")
    other.write_text("fedcba9876543210fedcba9876543210\n")
    places = [
        (machine, src, address) for machine in (one, other) for src in ("linux:1", "linux:3") for address in (104, 105)
    ]
    ids = [device_id(host="pi", src=src, address=address, machine_id=machine) for machine, src, address in places]
    assert len(set(ids)) == len(places)
    assert ids[0] == device_id(host="renamed", src="linux:1", address=104, machine_id=one)
    assert all(re.fullmatch(r"quavelet_[0-9a-f]{12}", one) for one in ids)


def test_the_machines_own_id_is_not_shown(tmp_path: Path) -> None:
    secret = tmp_path / "machine-id"
    secret.write_text("0123456789abcdef0123456789abcdef\n")
    assert device_id(host="pi", src="linux:1", address=104, machine_id=secret)[9:] not in secret.read_text()


def test_a_machine_without_an_id_is_known_by_its_name(tmp_path: Path) -> None:
    none = tmp_path / "none"
    ids = {device_id(host=host, src="linux:1", address=104, machine_id=none) for host in ("a", "b", "a")}
    assert len(ids) == 2


@given(st.text(max_size=80))
def test_no_host_name_reaches_into_another_topic(host: str) -> None:
    plan = mqtt_plan("mqtt:h")
    topic = topic_of(plan, host=host)
    assert re.fullmatch(r"quavelet/[A-Za-z0-9_-]{1,63}/imu", topic)
    assert re.fullmatch(r"[A-Za-z0-9_-]{1,120}", client_id_of(plan, host=host, device="quavelet_0123456789ab"))


def test_two_machines_of_one_name_do_not_push_each_other_off_the_broker() -> None:
    plan = mqtt_plan("mqtt:h")
    assert client_id_of(plan, host="raspberrypi", device="quavelet_000000000001") != client_id_of(
        plan, host="raspberrypi", device="quavelet_000000000002"
    )


def test_given_names_are_taken_as_they_are() -> None:
    plan = mqtt_plan("mqtt:h", topic="boat/mast", client_id="mast")
    assert (topic_of(plan, host="pi"), client_id_of(plan, host="pi", device="x")) == ("boat/mast", "mast")


def test_times_of_two_machines_can_be_compared_by_what_the_identity_says() -> None:
    identity = identity_of(STATUS, host="pi", topic="quavelet/pi/imu", encoding="json")
    assert (identity.clock, identity.boot_id) == (STATUS.clock, STATUS.boot_id)
