"""What five viewers of the live page cost: processor, the loop's punctuality, and how old what they get is.

    python tests/benchmarks/bench_web.py [--seconds 15] [--rounds 4] [--viewers 5]

One service on the fake chip, with the real-time settings as by default, for the whole time; by turns nobody looks on
and so many viewers do, which are another process. Lateness is that of the loop in those turns only. The page's share of
a processor is the time of the network's thread, which does nothing else here, and beside it what the whole program
takes more than in the turns without viewers.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from statistics import median

import msgspec

from quavelet.core.clock import MonotonicClock
from quavelet.loop.histogram import EDGES_NS
from quavelet.service.service import Service
from quavelet.settings import BusSettings, LoopSettings, Settings, WebSettings

WARM_UP_S = 4.0
BOUND_S = 30.0
BAR_CPU, BAR_LATE = 0.03, 1.5

LOOKING = r"""
import json, re, selectors, socket, statistics, sys, time
port, viewers, seconds = int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
hello = ("GET /live HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nOrigin: http://127.0.0.1:%d\r\nUpgrade: websocket\r\n"
         "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n")
message = re.compile(rb'"is":"message","now_ns":(\d+),"m":\{"v":1,"t_ns":(\d+)')
selector = selectors.DefaultSelector()
for _ in range(viewers):
    sock = socket.create_connection(("127.0.0.1", port))
    sock.sendall((hello % (port, port)).encode())
    selector.register(sock, selectors.EVENT_READ)
sent, sampled = [], []
begin = time.monotonic() + 1.0
end = begin + seconds
while (now := time.monotonic()) < end:
    for key, _ in selector.select(end - now):
        data = key.fileobj.recv(1 << 20)
        at = time.monotonic_ns()
        if not data:
            sys.exit("a viewer was dropped")
        if now < begin:
            continue
        for match in message.finditer(data):
            sent.append(at - int(match[1]))
            sampled.append(at - int(match[2]))
print(json.dumps({"rate_hz": len(sent) / viewers / seconds, "sent_ms": statistics.median(sent) / 1e6,
                  "sampled_ms": statistics.median(sampled) / 1e6}))
"""


class Seen(msgspec.Struct):
    """By the viewers: messages a second to each, and the median age since it was sent and since the sample."""

    rate_hz: float
    sent_ms: float
    sampled_ms: float


@dataclass(frozen=True)
class Turn:
    """One turn. late counts the loop's wake-ups as `Histogram` does; cpu is the program's share of one processor,
    page_cpu that of the network's thread."""

    late: tuple[int, ...]
    cpu: float
    page_cpu: float
    seen: Seen | None


def thread_s(thread: threading.Thread) -> float:
    """Processor time of one thread so far."""
    assert thread.ident is not None
    return time.clock_gettime(time.pthread_getcpuclockid(thread.ident))


def turn(service: Service, network: threading.Thread, *, seconds: float, viewers: int) -> Turn:
    """One turn, with so many looking on."""
    looking = None
    if viewers:
        assert service.outputs.page is not None
        arguments = [str(service.outputs.page.port), str(viewers), str(seconds)]
        looking = subprocess.Popen([sys.executable, "-c", LOOKING, *arguments], stdout=subprocess.PIPE)
        until(lambda: len(service.outputs.page.viewers) == viewers)
    # Coming and going is no part of it.
    time.sleep(1.0)
    assert service.imu is not None
    lateness = service.imu.loop.lateness
    late, cpu_s, page_s, began_s = lateness.counts, time.process_time(), thread_s(network), time.monotonic()
    time.sleep(seconds - 1.0)
    took_s = time.monotonic() - began_s
    counted = tuple(b - a for a, b in zip(late, lateness.counts, strict=True))
    cpu, page_cpu = (time.process_time() - cpu_s) / took_s, (thread_s(network) - page_s) / took_s
    seen = None
    if looking is not None:
        told, _ = looking.communicate(timeout=BOUND_S)
        seen = msgspec.json.decode(told, type=Seen)
    return Turn(counted, cpu, page_cpu, seen)


def until(condition: object) -> None:
    assert callable(condition)
    end_s = time.monotonic() + BOUND_S
    while not condition():
        if time.monotonic() > end_s:
            raise TimeoutError("it did not come about")
        time.sleep(0.05)


def percentile_ms(turns: Sequence[Turn], p: float) -> float:
    """Of the lateness in all these turns, the upper edge of its bin."""
    counts = [sum(column) for column in zip(*(each.late for each in turns), strict=True)]
    wanted = p / 100 * sum(counts)
    at = next(i for i, seen in enumerate(accumulate(counts)) if seen >= wanted)
    return EDGES_NS[min(at, len(EDGES_NS) - 1)] / 1e6


def compare(*, seconds: float, rounds: int, viewers: int) -> tuple[list[Turn], list[Turn]]:
    """The turns without and with viewers."""
    settings = Settings(bus=BusSettings(name="fake:tilt"), loop=LoopSettings(), web=WebSettings(listen="127.0.0.1:0"))
    service = Service(settings, clock=MonotonicClock(), talk=lambda _: None, environ={})
    alone: list[Turn] = []
    watched: list[Turn] = []
    failed: list[BaseException] = []

    def drive() -> None:
        try:
            until(lambda: service.state == "running")
            time.sleep(WARM_UP_S)
            network = next(thread for thread in threading.enumerate() if thread.name == "network")
            for _ in range(rounds):
                alone.append(turn(service, network, seconds=seconds, viewers=0))
                watched.append(turn(service, network, seconds=seconds, viewers=viewers))
        except BaseException as error:  # noqa: BLE001
            failed.append(error)
        finally:
            service.stop()

    driver = threading.Thread(target=drive)
    driver.start()
    service.run()
    driver.join()
    if failed:
        raise failed[0]
    return alone, watched


def report(alone: Sequence[Turn], watched: Sequence[Turn]) -> Iterator[str]:
    seen = [each.seen for each in watched if each.seen is not None]
    page_cpu = median(each.page_cpu for each in watched)
    more = median(each.cpu for each in watched) - median(each.cpu for each in alone)
    yield f"the page's thread {page_cpu:.1%} of a core with viewers (bar {BAR_CPU:.0%}), " + (
        f"{median(each.page_cpu for each in alone):.1%} without; the whole program {more:+.1%}"
    )
    for p in (50, 99, 99.9):
        without, with_them = percentile_ms(alone, p), percentile_ms(watched, p)
        bar = f" (bar {BAR_LATE})" if p == 99 else ""
        yield f"late p{p:g} {without:.3f} ms without, {with_them:.3f} ms with: ratio {with_them / without:.2f}{bar}"
    yield f"{median(s.rate_hz for s in seen):.1f} messages/s to each viewer"
    yield (
        f"median age at the viewer: {median(s.sent_ms for s in seen):.2f} ms since it was sent, "
        f"{median(s.sampled_ms for s in seen):.1f} ms since the sample"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--viewers", type=int, default=5)
    asked = parser.parse_args()
    load = Path("/proc/loadavg").read_text().split()[0]
    how = f"{asked.rounds} rounds of {asked.seconds:g} s, {asked.viewers} viewers"
    print(f"{os.cpu_count()} processors, load {load}; {how}")
    alone, watched = compare(seconds=asked.seconds, rounds=asked.rounds, viewers=asked.viewers)
    print(*report(alone, watched), sep="\n")


if __name__ == "__main__":
    main()
