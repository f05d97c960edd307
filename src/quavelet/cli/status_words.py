"""A `Status` in words, on one screen: how it is, what each output does, and what is wrong and what to do about it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

from quavelet.cli.counts import in_words as counts_in_words
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS
from quavelet.sinks.message import Message
from quavelet.sinks.spans import span_in_words
from quavelet.sinks.status import OutputStatus, PageStatus, Status

MISSED_SHARE = 0.01
"""A larger share of deadlines missed is something to look after."""

_NO_BROKER = "waiting for the broker: "


def in_words(status: Status) -> Iterator[str]:
    """The lines, without what could steer a terminal."""
    for line in _lines(status):
        yield "".join(c if c.isprintable() else "?" for c in line)


def health_of(status: Status) -> Health:
    """The counters that this version knows."""
    known = {field.name for field in fields(Health)}
    return Health(**{name: count for name, count in status.health.items() if name in known})


def _lines(status: Status) -> Iterator[str]:
    yield f"{status.name}: {status.state}{', NOT A REAL CHIP' if status.fake else ''}"
    for name, text in _facts(status):
        yield f"  {name:<12}{text}"
    for output in status.outputs:
        yield f"  output      {_output(output)}"
    wrong = list(_wrong(status))
    yield "all well" if not wrong else "to look after:"
    for text in wrong:
        yield f"  {text}"


def _facts(status: Status) -> Iterator[tuple[str, str]]:
    rate = "rate not measured yet" if status.rate_hz is None else f"{status.rate_hz:.2f} samples/s"
    yield "chip", f"{status.chip or 'none yet'} at 0x{status.address:02x} on {status.src}, {rate}"
    if status.message is not None:
        yield "attitude", _attitude(status.message)
        yield "doubt", ", ".join(status.message.flags) or "none"
    health, loop, latency = health_of(status), status.loop, status.latency
    whole = health.samples + health.samples_lost
    yield "lost", f"{health.samples_lost} of {whole} samples in {health.gaps} gaps"
    late = _times(loop.lateness_p50_ns, loop.lateness_p99_ns, loop.lateness_max_ns)
    yield "loop", f"late {late}; {loop.missed} of {loop.ticks + loop.missed} deadlines missed"
    if latency.count:
        yield "latency", f"drain to output {_times(latency.p50_ns, latency.p99_ns, latency.max_ns)}"
    yield "calibration", status.calibration or "none"
    if status.recording is not None:
        recording = status.recording
        yield "recording", f"{recording.state}, {recording.bytes / 1e6:.0f} MB {recording.file}"
    if status.page is not None:
        yield "page", _page(status.page)
    kept = {True: "kept by a time server", False: "not kept by a time server", None: "not known whether kept"}
    steps = status.clock.steps
    was_set = f", set {steps} time{'s' if steps > 1 else ''} since the start" if steps else ""
    yield "clock", kept[status.clock.synchronised] + was_set
    yield (
        "program",
        f"quavelet {status.version}, up {span_in_words(status.uptime_s)}, {status.memory_mb:.0f} MB, pid {status.pid}",
    )


def _attitude(m: Message) -> str:
    x, y, z = m.sigma_deg
    return (
        f"roll {m.roll_deg:+.2f}°, pitch {m.pitch_deg:+.2f}°, yaw {m.yaw_deg:+.2f}° ({m.yaw}), "
        f"± {x:.2f}° {y:.2f}° {z:.2f}°, {'still' if m.still else 'moving'}, {m.temp_degc:.1f} °C"
    )


def _output(output: OutputStatus) -> str:
    text = f"{output.name} {output.encoding} {output.to}: {output.state}; {output.sent} sent, {output.lost} lost"
    if output.to.startswith(("unix:", "tcp:")):
        text += f", {output.readers} readers"
    return text


def _page(page: PageStatus) -> str:
    counts = [f"{n} refused ({why})" for why, n in page.refused.items()]
    counts += [f"{n} dropped ({why})" for why, n in page.dropped.items()]
    return ", ".join([f"{page.now} looking on", *counts])


def _wrong(status: Status) -> Iterator[str]:
    if status.state.startswith(("waiting", "lost")):
        yield f"no samples come: `quavelet doctor --bus {status.src}` says why, once the service is stopped"
    yield from counts_in_words(health_of(status))
    loop = status.loop
    if loop.missed > MISSED_SHARE * (loop.ticks + loop.missed):
        yield "many deadlines are missed: the host is too busy, or real-time settings were refused (see the journal)"
    for output in status.outputs:
        key = f"output.{output.name}"
        if output.state.startswith("failed"):
            yield f"{key} does not work and is tried again: {output.state.removeprefix('failed: ')}"
        elif output.state.startswith(_NO_BROKER):
            yield f"{key} has no broker: {output.state.removeprefix(_NO_BROKER)}; {output.lost} messages lost so far"
        elif output.lost and output.to.startswith("mqtt"):
            yield f"{key} has lost {output.lost} messages: its broker was away, or is too slow, lower {key}.rate_hz"
        elif output.lost:
            yield f"{key} has lost {output.lost} messages: its reader or its network is too slow, lower {key}.rate_hz"
        if output.refused:
            yield f"{key} has turned readers away, {output.refused} times: raise {key}.readers"
    recording = status.recording
    if recording is not None and (recording.lost or recording.state.startswith("stopped")):
        lost = f"{recording.lost} {recording.kind}"
        yield f"the recording is {recording.state} and has lost {lost}: is the disk full, or too slow?"
    if status.clock.synchronised is False:
        yield "the time of day is not kept by a time server: do not compare it with other machines (see `timedatectl`)"


def _times(p50_ns: int, p99_ns: int, max_ns: int) -> str:
    return f"{p50_ns / NS_PER_MS:.2f} ms p50, {p99_ns / NS_PER_MS:.2f} ms p99, {max_ns / NS_PER_MS:.2f} ms at most"
