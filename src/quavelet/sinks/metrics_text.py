"""A `Status` in Prometheus' text format: units in the names, counters end in _total, `name` and `src` on every line.

Doubt: an attitude that may not be used, or is of before the chip was lost, has no lines; each flag has one that is 0 or
1, and what is no number is left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

from quavelet.core.blocks import Flag
from quavelet.core.units import NS_PER_S
from quavelet.sinks.encodings.ship_axes import NO_ATTITUDE
from quavelet.sinks.message import Message
from quavelet.sinks.status import OutputStatus, Status

Labels = Mapping[str, str]


class MetricsText:
    """Lines in the making; `labels` are on each of them."""

    def __init__(self, labels: Labels) -> None:
        self._labels = labels
        self._lines: list[str] = []

    def gauge(self, name: str, help_text: str, *values: tuple[Labels, float | None]) -> None:
        """One metric with a line for each value that is a number."""
        self._add("gauge", name, help_text, values)

    def counter(self, name: str, help_text: str, *values: tuple[Labels, float | None]) -> None:
        """The same of what only grows; `name` is given its _total."""
        self._add("counter", f"{name}_total", help_text, values)

    def text(self) -> str:
        return "".join(f"{line}\n" for line in self._lines)

    def _add(self, kind: str, name: str, help_text: str, values: tuple[tuple[Labels, float | None], ...]) -> None:
        numbers = [(labels, value) for labels, value in values if value is not None and isfinite(value)]
        if numbers:
            self._lines += [f"# HELP quavelet_{name} {help_text}", f"# TYPE quavelet_{name} {kind}"]
        for own, value in numbers:
            labels = ",".join(f'{key}="{_escaped(text)}"' for key, text in {**self._labels, **own}.items())
            self._lines.append(f"quavelet_{name}{{{labels}}} {value!r}")


def metrics_text(status: Status, *, answers: Mapping[str, int]) -> str:
    """The figures of the service; `answers` are the endpoint's own, by status code."""
    text = MetricsText({"name": status.name, "src": status.src})
    about = {"chip": status.chip, "version": status.version, "fake": str(status.fake).lower()}
    text.gauge("info", "What it is; the value is always 1.", (about, 1))
    text.gauge("running", "Whether the state is running.", ({}, int(status.state == "running")))
    text.gauge("uptime_seconds", "Since the program started.", ({}, status.uptime_s))
    text.gauge("resident_memory_bytes", "Memory the program takes.", ({}, status.memory_mb * 1e6))
    text.gauge("sample_rate_hertz", "The chip's sample rate by the host's clock.", ({}, status.rate_hz))
    if status.message is not None:
        _add_message(text, status.message, status)
    for counter, count in status.health.items():
        text.counter(counter, f"Counter {counter} of the chip's health.", ({}, count))
    _add_times(text, status)
    _add_outputs(text, status.outputs)
    if status.recording is not None:
        text.gauge("recording_bytes", "What all files of the recording take.", ({}, status.recording.bytes))
        text.counter("recording_lost_drains", "Drains the disk was too slow for.", ({}, status.recording.lost))
    if status.page is not None:
        text.gauge("page_viewers", "Who looks at the live page.", ({}, status.page.now))
        text.counter("page_lost", "Messages that a slow viewer did not get.", ({}, status.page.lost))
        refused, dropped = sorted(status.page.refused.items()), sorted(status.page.dropped.items())
        text.counter("page_refused", "Requests refused, by the reason.", *(({"why": why}, n) for why, n in refused))
        text.counter("page_dropped", "Viewers dropped, by the reason.", *(({"why": why}, n) for why, n in dropped))
    text.counter(
        "metrics_requests",
        "Requests for these figures by the code they were answered with.",
        *(({"code": code}, count) for code, count in sorted(answers.items())),
    )
    return text.text()


def _add_message(text: MetricsText, message: Message, status: Status) -> None:
    raised = set(message.flags)
    names = [str(flag.name).lower() for flag in Flag]
    text.gauge("flag", "What is doubtful.", *(({"flag": name}, int(name in raised)) for name in names))
    at_s = (message.t_ns + status.clock.offset_ns) / NS_PER_S
    text.gauge("message_timestamp_seconds", "Unix time of the last sample.", ({}, at_s))
    if status.state not in ("running", "settling"):
        return
    text.gauge("temperature_celsius", "Of the chip.", ({}, message.temp_degc))
    text.gauge("still", "Whether the board stands still.", ({}, int(message.still)))
    if raised & NO_ATTITUDE:
        return
    text.gauge("roll_degrees", "About x.", ({}, message.roll_deg))
    text.gauge("pitch_degrees", "About y.", ({}, message.pitch_deg))
    text.gauge("yaw_degrees", "About z, counter-clockwise from above.", ({"origin": message.yaw}, message.yaw_deg))
    sigma = zip("xyz", message.sigma_deg, strict=True)
    text.gauge("sigma_degrees", "One sigma about the world's axes.", *(({"axis": a}, s) for a, s in sigma))


def _add_times(text: MetricsText, status: Status) -> None:
    loop, latency, clock = status.loop, status.latency, status.clock
    text.counter("loop_ticks", "Deadlines that were served.", ({}, loop.ticks))
    text.counter("loop_missed", "Deadlines that were skipped.", ({}, loop.missed))
    for name, help_text, p50, p99, most in (
        ("loop_lateness", "From the deadline to the wake-up", loop.lateness_p50_ns, loop.lateness_p99_ns,
         loop.lateness_max_ns),
        ("loop_duration", "Of one tick", loop.duration_p50_ns, loop.duration_p99_ns, loop.duration_max_ns),
        ("latency", "From the drain to an output", latency.p50_ns, latency.p99_ns, latency.max_ns),
    ):  # fmt: skip
        for part, value in (("p50", p50), ("p99", p99), ("max", most)):
            text.gauge(f"{name}_{part}_seconds", f"{help_text}: {part} since the start.", ({}, value / NS_PER_S))
    text.gauge("clock_offset_seconds", "CLOCK_REALTIME minus CLOCK_MONOTONIC.", ({}, clock.offset_ns / NS_PER_S))
    known = None if clock.synchronised is None else int(clock.synchronised)
    text.gauge("clock_synchronised", "Whether a time server keeps the clock.", ({}, known))


def _add_outputs(text: MetricsText, outputs: list[OutputStatus]) -> None:
    def each(counter: str) -> list[tuple[Labels, float | None]]:
        return [({"output": o.name, "encoding": o.encoding}, getattr(o, counter)) for o in outputs]

    text.counter("output_sent", "Messages that went out, to each reader.", *each("sent"))
    text.counter("output_lost", "Messages that should have gone out and did not.", *each("lost"))
    text.counter("output_left_out", "Messages left out by rate or dead band.", *each("left_out"))
    text.counter("output_bytes", "Bytes that went out.", *each("bytes"))
    text.counter("output_refused", "Readers turned away.", *each("refused"))
    text.gauge("output_readers", "Readers connected.", *each("readers"))


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")
