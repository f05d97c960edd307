"""What the loop notices of a flood of connections, and how long one who means it waits meanwhile.

    python tests/benchmarks/bench_flood_outputs.py [--seconds 10] [--rounds 2]

The program itself (`quavelet run` on the fake chip at 200 drains a second) runs by turns alone and while another
process connects, asks and goes as fast as it can, at each place that listens. Beside the flood somebody connects, waits
for the first bytes, and tries again after 50 ms where he is turned away.
"""

from __future__ import annotations

import argparse
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from bench_outputs import BOUND_S, PROGRAM, asked, free_port, settings_text, until

PLACES = ("alone", "unix", "tcp", "control", "metrics")
QUESTIONS = {"unix": "", "tcp": "", "control": "status\n", "metrics": "GET /metrics HTTP/1.0\r\n\r\n"}

FLOOD = """
import socket, sys
place, question = sys.argv[1], sys.argv[2].encode()
made = 0
print("begun", flush=True)
while True:
    sock = socket.socket(socket.AF_UNIX if "/" in place else socket.AF_INET)
    sock.settimeout(None)
    try:
        sock.connect(place if "/" in place else ("127.0.0.1", int(place)))
        sock.sendall(question)
        made += 1
    except OSError:
        pass
    sock.close()
    if made % 20 == 0:
        print(made, flush=True)
"""


@dataclass(frozen=True)
class Flooded:
    """Of one run: deadlines served and missed, connections a second of the flood, and how long others waited, s."""

    ticks: int
    missed: int
    late_p99_ms: float
    flood_hz: float
    waits_s: list[float]


def run(folder: Path, place: str, *, seconds: float) -> Flooded:
    """The program beside a flood at one place."""
    folder.mkdir()
    (folder / "recordings").mkdir()
    ports = {name: free_port() for name in ("metrics", "tcp", "udp")}
    config, control = folder / "imu.toml", folder / "control.sock"
    config.write_text(settings_text(folder, sample_hz=200.0, loop_hz=200.0, ports=ports))
    at = {
        "unix": f"{folder}/json.sock",
        "control": str(control),
        "tcp": str(ports["tcp"]),
        "metrics": str(ports["metrics"]),
    }
    waits_s: list[float] = []
    flood_hz = 0.0
    with ExitStack() as stack:
        program = stack.enter_context(
            subprocess.Popen(
                [*PROGRAM, "run", "--config", config, "--json"],
                stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
            )
        )  # fmt: skip
        stack.callback(program.kill)
        until(lambda: asked(control) is not None, "the program never answered")
        if place == "alone":
            time.sleep(seconds)
        else:
            words = [sys.executable, "-c", FLOOD, at[place], QUESTIONS[place]]
            flood = stack.enter_context(subprocess.Popen(words, stdout=subprocess.PIPE, text=True))
            stack.callback(flood.kill)
            made: list[str] = []
            assert flood.stdout is not None
            counting = threading.Thread(target=made.extend, args=(flood.stdout,), daemon=True)
            counting.start()
            end_s = time.monotonic() + seconds
            while time.monotonic() < end_s:
                time.sleep(0.5)
                waits_s.append(wait_s(at[place], QUESTIONS[place].encode()))
            flood.kill()
            counting.join(BOUND_S)
            flood_hz = int(made[-1]) / (time.monotonic() - end_s + seconds)
        program.send_signal(signal.SIGTERM)
        assert program.stderr is not None
        said = program.stderr.read()
        program.wait(BOUND_S)
    match = re.search(r"loop: (\d+) ticks, (\d+) missed, late ([\d.]+) ms p50, ([\d.]+) ms p99", said)
    assert match is not None, said
    return Flooded(int(match[1]), int(match[2]), float(match[4]), flood_hz, waits_s)


def wait_s(place: str, question: bytes) -> float:
    """From the first try to the first bytes of an answer."""
    began_s = time.monotonic()
    while time.monotonic() < began_s + BOUND_S:
        with socket.socket(socket.AF_UNIX if "/" in place else socket.AF_INET) as sock:
            try:
                sock.connect(place if "/" in place else ("127.0.0.1", int(place)))
                sock.settimeout(BOUND_S)
                sock.sendall(question)
                answer = sock.recv(4096)
            except OSError:
                answer = b""
        if answer and b"others ask" not in answer and b" 503 " not in answer:
            return time.monotonic() - began_s
        time.sleep(0.05)
    return BOUND_S


def report(runs: dict[str, list[Flooded]]) -> list[str]:
    """A line for each place, over its rounds."""
    lines = []
    for place, rounds in runs.items():
        ticks, missed = sum(one.ticks for one in rounds), sum(one.missed for one in rounds)
        line = (
            f"  {place:<8} {missed} of {ticks + missed} missed, late {median(r.late_p99_ms for r in rounds):.2f} ms p99"
        )
        waits_s = [wait for one in rounds for wait in one.waits_s]
        if waits_s:
            line += f", {median(one.flood_hz for one in rounds):.0f} connections/s"
            line += f"; others waited {median(waits_s):.2f} s, {max(waits_s):.2f} s at most"
        lines.append(line)
    return lines


def compare(seconds: float, rounds: int) -> dict[str, list[Flooded]]:
    """Each place by turns."""
    with tempfile.TemporaryDirectory() as folder:
        done: dict[str, list[Flooded]] = {place: [] for place in PLACES}
        for k in range(rounds):
            for place in PLACES:
                done[place].append(run(Path(folder, f"{place}{k}"), place, seconds=seconds))
        return done


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rounds", type=int, default=2)
    given = parser.parse_args()
    for line in report(compare(given.seconds, given.rounds)):
        print(line, flush=True)


if __name__ == "__main__":
    main()
