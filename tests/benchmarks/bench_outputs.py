"""What all outputs together cost the loop: punctuality, latency, processor and memory, with and without them.

    python tests/benchmarks/bench_outputs.py [--seconds 20] [--rounds 3]

The program itself (`quavelet run` on the fake chip, real-time settings as by default) runs by turns alone, with one
reader of the local socket, and with every output on and eight socket readers, one of which never reads; all of the same
minutes on the same machine. The lateness is what the program says at its end, the latency what `quavelet status` says
before it: from the last byte of a drain to the hand-over to the kernel, over all outputs, so the pipeline is in it. The
fake's own work is in the processor's share of all three.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from statistics import median

import msgspec

from quavelet.sinks.asking import AskError, ask_status
from quavelet.sinks.status import Status

PROGRAM = [sys.executable, "-c", "from quavelet.cli.app import main; main()"]
WARM_UP_S = 3.0
BOUND_S = 30.0
CASES = ((200.0, 200.0), (1000.0, 200.0))
"""Samples a second of the chip, and drains."""
MODES = ("alone", "one reader", "all outputs, 8 readers", "alone again")

READERS = """
import selectors, socket, sys
selector = selectors.DefaultSelector()
keep = []
for place in sys.argv[1:]:
    if place.startswith("tcp:"):
        sock = socket.create_connection(("127.0.0.1", int(place[4:])))
    else:
        sock = socket.socket(socket.AF_UNIX)
        sock.connect(place.removeprefix("never:"))
    keep.append(sock)
    if not place.startswith("never:"):
        sock.setblocking(False)
        selector.register(sock, selectors.EVENT_READ)
print("connected", flush=True)
while selector.get_map():
    for key, _ in selector.select():
        if not key.fileobj.recv(65536):
            selector.unregister(key.fileobj)
"""


@dataclass(frozen=True)
class Figures:
    """Of one run. cpu is the share of one processor, rss_mb resident memory at its end."""

    late_p50_ms: float
    late_p99_ms: float
    missed: int
    ticks: int
    cpu: float
    rss_mb: float
    status: Status


def free_port() -> int:
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


def settings_text(folder: Path, *, sample_hz: float, loop_hz: float, ports: dict[str, int] | None) -> str:
    """A settings file: alone, or with every output there is here."""
    text = f"""
[bus]
name = "fake:tilt"
[chip]
gyro_range_dps = 500
accel_range_g = 4
dlpf = 3
sample_rate_hz = {sample_hz}
[loop]
rate_hz = {loop_hz}
[service]
socket = "{folder}/control.sock"
state_file = ""
"""
    if ports is None:
        return text
    text += f"""metrics = "127.0.0.1:{ports["metrics"]}"
[recording]
directory = "{folder}/recordings"
[output.unix]
to = "unix:{folder}/json.sock"
[output.tcp]
to = "tcp:127.0.0.1:{ports["tcp"]}"
encoding = "nmea"
"""
    wanted = ["json", "nmea", "signalk", "influx", "opentrack"] + (["mavlink"] if find_spec("pymavlink") else [])
    for encoding in wanted:
        text += f'[output.udp-{encoding}]\nto = "udp:127.0.0.1:{ports["udp"]}"\nencoding = "{encoding}"\n'
    if "mqtt" in ports:
        text += f'[output.mqtt]\nto = "mqtt:127.0.0.1:{ports["mqtt"]}"\n'
    return text


@contextmanager
def broker(port: int) -> Iterator[None]:
    with tempfile.NamedTemporaryFile("w", suffix=".conf") as config:
        config.write(f"listener {port} 127.0.0.1\nallow_anonymous true\n")
        config.flush()
        with subprocess.Popen(["mosquitto", "-c", config.name], stderr=subprocess.DEVNULL) as running:
            try:
                yield
            finally:
                running.terminate()


def until(condition: object, what: str) -> None:
    assert callable(condition)
    end_s = time.monotonic() + BOUND_S
    while not condition():
        if time.monotonic() > end_s:
            raise TimeoutError(what)
        time.sleep(0.05)


def cpu_s(pid: int) -> float:
    """Processor time so far, all threads."""
    words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def run(folder: Path, *, sample_hz: float, loop_hz: float, seconds: float, mode: str) -> Figures:
    """The program for so long after it has warmed up."""
    folder.mkdir()
    (folder / "recordings").mkdir()
    with ExitStack() as stack:
        ports = {name: free_port() for name in ("metrics", "tcp", "udp")} if mode == MODES[2] else None
        if ports is not None and shutil.which("mosquitto") and find_spec("paho"):
            ports["mqtt"] = free_port()
            stack.enter_context(broker(ports["mqtt"]))
        config = folder / "imu.toml"
        config.write_text(settings_text(folder, sample_hz=sample_hz, loop_hz=loop_hz, ports=ports))
        program = stack.enter_context(
            subprocess.Popen(
                [*PROGRAM, "run", "--config", config, "--json"],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            )
        )
        stack.callback(program.kill)
        control = folder / "control.sock"
        until(lambda: asked(control) is not None, "the program never answered")
        if mode == MODES[1]:
            watcher = socket.socket(socket.AF_UNIX)
            stack.enter_context(watcher)
            watcher.connect(str(control))
            watcher.sendall(b"watch\n")
            threading.Thread(target=drop_all, args=(watcher,), daemon=True).start()
        if ports is not None:
            places = [f"never:{folder}/json.sock", *3 * [f"{folder}/json.sock"], *4 * [f"tcp:{ports['tcp']}"]]
            readers = stack.enter_context(
                subprocess.Popen([sys.executable, "-c", READERS, *places], stdout=subprocess.PIPE)
            )
            stack.callback(readers.kill)
            assert readers.stdout is not None and readers.stdout.readline() == b"connected\n"
        time.sleep(WARM_UP_S)
        began_s, before_s = time.monotonic(), cpu_s(program.pid)
        time.sleep(seconds)
        cpu = (cpu_s(program.pid) - before_s) / (time.monotonic() - began_s)
        status = asked(control)
        assert status is not None
        program.send_signal(signal.SIGTERM)
        assert program.stderr is not None
        said = program.stderr.read()
        program.wait(BOUND_S)
    match = re.search(r"loop: (\d+) ticks, (\d+) missed, late ([\d.]+) ms p50, ([\d.]+) ms p99", said)
    assert match is not None, said
    return Figures(
        late_p50_ms=float(match[3]),
        late_p99_ms=float(match[4]),
        missed=int(match[2]),
        ticks=int(match[1]),
        cpu=cpu,
        rss_mb=status.memory_mb,
        status=status,
    )


def drop_all(sock: socket.socket) -> None:
    """Read until the other side ends."""
    with suppress(OSError):
        while sock.recv(65_536):
            pass


def asked(control: Path) -> Status | None:
    """The status of a program that runs already."""
    try:
        status = msgspec.json.decode(ask_status(control), type=Status)
    except AskError:
        return None
    return status if status.state == "running" else None


Round = dict[str, Figures]


def compare(sample_hz: float, loop_hz: float, *, seconds: float, rounds: int) -> list[Round]:
    """Each mode by turns."""
    with tempfile.TemporaryDirectory() as folder:
        return [
            {
                mode: run(Path(folder, f"{k}{n}"), sample_hz=sample_hz, loop_hz=loop_hz, seconds=seconds, mode=mode)
                for n, mode in enumerate(MODES)
            }
            for k in range(rounds)
        ]


def ratios(rounds: list[Round]) -> list[float]:
    """Lateness p99 with all outputs to that alone, of each round."""
    return [done[MODES[2]].late_p99_ms / done[MODES[0]].late_p99_ms for done in rounds]


def noise(rounds: list[Round]) -> list[float]:
    """The same of alone to alone: what the machine itself does to the figure."""
    return [done[MODES[3]].late_p99_ms / done[MODES[0]].late_p99_ms for done in rounds]


def report(sample_hz: float, loop_hz: float, rounds: list[Round]) -> Iterator[str]:
    """The lines of one case; medians of the rounds."""
    yield f"{sample_hz:.0f} samples/s, {loop_hz:.0f} drains/s, {len(rounds)} rounds"
    for mode in MODES:
        figures = [done[mode] for done in rounds]
        ticks, missed = sum(f.ticks for f in figures), sum(f.missed for f in figures)
        line = (
            f"  {mode:<24} late {median(f.late_p50_ms for f in figures):.3f} ms p50, "
            f"{median(f.late_p99_ms for f in figures):.3f} ms p99, {missed} of {ticks + missed} missed, "
            f"cpu {100 * median(f.cpu for f in figures):.0f} %, {median(f.rss_mb for f in figures):.0f} MB"
        )
        latencies = [f.status.latency for f in figures]
        if latencies[0].count:
            p50_ns, p99_ns = median(x.p50_ns for x in latencies), median(x.p99_ns for x in latencies)
            line += f", drain to output {p50_ns / 1e6:.2f} ms p50, {p99_ns / 1e6:.2f} ms p99"
        yield line
    for words, each in (("all outputs to alone", ratios(rounds)), ("alone again to alone", noise(rounds))):
        yield f"  lateness p99, {words}: {', '.join(f'{r:.2f}' for r in each)}; median {median(each):.2f}"
    for output in rounds[-1][MODES[2]].status.outputs:
        yield f"    {output.name:<14} {output.sent} sent, {output.lost} lost, {output.readers} readers, {output.state}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--only", type=float, help="Samples a second of the one case that is wanted.")
    given = parser.parse_args()
    for sample_hz, loop_hz in (case for case in CASES if given.only in (None, case[0])):
        for line in report(sample_hz, loop_hz, compare(sample_hz, loop_hz, seconds=given.seconds, rounds=given.rounds)):
            print(line, flush=True)


if __name__ == "__main__":
    main()
