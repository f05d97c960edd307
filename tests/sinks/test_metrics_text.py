"""The figures, read back by Prometheus' own parser."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sink_messages import FLAGS, broken_messages, message
from sink_status import status

from quavelet.core.health import Health
from quavelet.sinks.metrics_text import metrics_text
from quavelet.sinks.status import PageStatus, Status

parser = pytest.importorskip(
    "prometheus_client.parser", reason="prometheus_client is not installed: pip install prometheus-client"
)

Sample = tuple[dict[str, str], float]


def samples(of: Status, **answers: int) -> dict[str, list[Sample]]:
    """Values by name, each with its labels; fails on what the format does not allow."""
    found: dict[str, list[Sample]] = {}
    for family in parser.text_string_to_metric_families(metrics_text(of, answers=answers)):
        assert family.type in ("gauge", "counter") and family.documentation
        for sample in family.samples:
            assert (family.type == "counter") == sample.name.endswith("_total")
            found.setdefault(sample.name, []).append((sample.labels, sample.value))
    for name, values in found.items():
        labels = [tuple(sorted(own.items())) for own, _ in values]
        assert len(set(labels)) == len(labels), f"{name} has a line twice"
    return found


def value(of: Status, name: str) -> float:
    ((_, number),) = samples(of)[f"quavelet_{name}"]
    return number


def test_every_counter_of_the_health_is_there_by_its_name():
    found = samples(status())
    assert {f"quavelet_{name}_total" for name in Health().as_dict()} <= set(found)
    assert value(status(), "samples_total") == 2500 and value(status(), "gaps_total") == 3


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("uptime_seconds", 12.5),
        ("sample_rate_hertz", 200.25),
        ("temperature_celsius", 31.25),
        ("resident_memory_bytes", 41_500_000),
        ("latency_p99_seconds", 0.0005),
        ("loop_lateness_max_seconds", 0.00012),
        ("loop_missed_total", 2),
        ("recording_bytes", 123_456),
        ("recording_lost_drains_total", 5),
        ("message_timestamp_seconds", 1_700_000_000.0),
        ("clock_synchronised", 1),
    ],
)
def test_figures_have_their_unit_in_the_name(name, number):
    assert value(status(), name) == pytest.approx(number)


def test_every_line_says_whose_it_is():
    for values in samples(status(name="boat", src="fake:tilt"), **{"200": 3}).values():
        assert all((labels["name"], labels["src"]) == ("boat", "fake:tilt") for labels, _ in values)


def test_outputs_are_told_apart():
    found = samples(status())
    lost = {labels["output"]: (labels["encoding"], number) for labels, number in found["quavelet_output_lost_total"]}
    assert lost == {"phone": ("nmea", 4), "plot": ("json", 0)}


def test_a_fake_says_so():
    ((labels, _),) = samples(status(src="fake:tilt"))["quavelet_info"]
    assert labels["fake"] == "true"


@given(st.text(), st.text())
def test_no_name_can_add_a_label_or_a_line(name, src):
    plain, odd = metrics_text(status(), answers={}), metrics_text(status(name=name, src=src), answers={})
    assert odd.count("\n") == plain.count("\n")
    for values in samples(status(name=name, src=src)).values():
        assert all((labels["name"], labels["src"]) == (name, src) for labels, _ in values)


@pytest.mark.parametrize("flag", ["settling", "stuck"])
def test_an_attitude_that_may_not_be_used_has_no_lines(flag):
    found = samples(status(last=message(flags=[flag])))
    assert not {"quavelet_roll_degrees", "quavelet_pitch_degrees", "quavelet_yaw_degrees"} & set(found)
    raised = {labels["flag"] for labels, number in found["quavelet_flag"] if number == 1}
    assert raised == {flag} and len(found["quavelet_flag"]) == len(FLAGS)


@pytest.mark.parametrize("state", ["lost: nothing answers at 0x68", "waiting for the chip"])
def test_the_last_attitude_of_a_lost_chip_is_not_told_as_the_present_one(state):
    found = samples(status(state=state))
    assert "quavelet_roll_degrees" not in found and "quavelet_temperature_celsius" not in found
    assert found["quavelet_running"][0][1] == 0 and "quavelet_message_timestamp_seconds" in found


def test_a_yaw_says_what_it_counts_from():
    ((labels, _),) = samples(status())["quavelet_yaw_degrees"]
    assert labels["origin"] == "relative"


@given(broken_messages())
def test_what_is_no_number_is_left_out(told):
    for values in samples(status(last=told)).values():
        assert all(number == number and abs(number) != float("inf") for _, number in values)


def test_a_service_that_has_seen_nothing_yet_has_figures_too():
    young = msgspec.structs.replace(status(last=None, state="waiting for the chip"), rate_hz=None, recording=None)
    found = samples(young)
    assert "quavelet_sample_rate_hertz" not in found and "quavelet_flag" not in found
    assert found["quavelet_running"][0][1] == 0


def test_who_looks_at_the_page_is_counted_by_what_became_of_them():
    page = PageStatus(now=2, lost=5, refused={"token": 3, "origin": 1}, dropped={"stalled": 1})
    found = samples(msgspec.structs.replace(status(), page=page))
    assert [number for _, number in found["quavelet_page_viewers"]] == [2]
    assert {labels["why"]: number for labels, number in found["quavelet_page_refused_total"]} == page.refused
    assert {labels["why"]: number for labels, number in found["quavelet_page_dropped_total"]} == page.dropped
    assert "quavelet_page_viewers" not in samples(status())
