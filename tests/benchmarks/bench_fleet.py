"""How many boards one broker takes: instances that publish at QoS 1 to a real mosquitto, counted by a subscriber.

    python tests/benchmarks/bench_fleet.py [INSTANCES] [SECONDS]

All is on this machine, so broker, subscriber and instances share its processors; on Pis each instance has its own.
"""

from __future__ import annotations

import asyncio
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "contract"))

import msgspec
import numpy as np
from mosquitto_broker import Broker
from output_plans import MESSAGE, mqtt_plan
from waiting import eventually

from quavelet.sinks.encodings.json import Json
from quavelet.sinks.transports.mqtt import MqttTransport

RATE_HZ = 50.0
PROCESSES = 4


@dataclass(frozen=True, slots=True)
class Published:
    """What some instances say of themselves: `given` to their transports, `taken` by the broker, `lost` by their own
    count; processor time from the first message on, in s."""

    given: int
    taken: int
    lost: int
    cpu_s: float


@dataclass(frozen=True, slots=True)
class FleetResult:
    """The instances' word beside the subscriber's: `heard` of all that was given, each once; `twice` came again.

    latency_ms   from the message's time to the subscriber, percentiles 50, 99 and 100
    """

    instances: int
    seconds: float
    published: Published
    heard: int
    twice: int
    latency_ms: tuple[float, float, float]
    broker_cpu_s: float

    @property
    def missing(self) -> int:
        return self.published.given - self.heard


def run_fleet(instances: int, *, seconds: float) -> FleetResult:
    """Needs mosquitto and mosquitto_sub."""
    with tempfile.TemporaryDirectory() as folder:
        # The subscriber's queue in the broker: by default it takes 1000 and then drops, which is no loss of ours.
        config = ("allow_anonymous true", "max_queued_messages 0", "set_tcp_nodelay true")
        with Broker(Path(folder), config=config) as broker:
            heard = Path(folder) / "heard"
            command = ["mosquitto_sub", "-V", "5", "-p", str(broker.port), "-q", "1", "-F", "%U %t %p"]
            with heard.open("wb") as out:
                subscriber = subprocess.Popen([*command, "-t", "fleet/+/attitude", "-t", "ready"], stdout=out)
            try:
                say = ["mosquitto_pub", "-p", str(broker.port), "-t", "ready", "-m", "?"]
                assert eventually(lambda: subprocess.run(say, check=True) is not None and heard.stat().st_size > 0)
                offset_ns = time.time_ns() - time.monotonic_ns()
                processes = min(PROCESSES, instances)
                shares = [len(range(first, instances, processes)) for first in range(processes)]
                jobs = [(broker.port, first, share, seconds) for first, share in enumerate(shares)]
                with get_context("spawn").Pool(processes) as pool:
                    published = pool.starmap(publish, jobs)
                total = Published(*(sum(getattr(one, key) for one in published) for key in Published.__slots__))
                eventually(lambda: heard.read_bytes().count(b"attitude") >= total.given, within_s=5.0)
                return _count(heard, instances, seconds, total, offset_ns=offset_ns, cpu_s=broker.cpu_s())
            finally:
                subscriber.kill()
                subscriber.wait()


def publish(port: int, first: int, share: int, seconds: float) -> Published:
    """In a process of its own: so many instances for so long."""
    return asyncio.run(_publish(port, first, share, seconds))


async def _publish(port: int, first: int, share: int, seconds: float) -> Published:
    encoding = Json()
    transports = [
        MqttTransport(mqtt_plan(f"mqtt:127.0.0.1:{port}", topic=f"fleet/{first}-{n}", service_name=f"{first}-{n}"))
        for n in range(share)
    ]
    for transport in transports:
        await transport.open()
    while any(transport.stats().state != "connected" for transport in transports):
        await asyncio.sleep(0.05)
    await asyncio.sleep(0.5)
    before_s = _cpu_s()
    loop = asyncio.get_running_loop()
    start_s = loop.time()
    ticks = round(seconds * RATE_HZ)

    async def feed(n: int, transport: MqttTransport) -> None:
        for tick in range(ticks):
            # Boards start when they like.
            await asyncio.sleep(max(0.0, start_s + (tick + n / share) / RATE_HZ - loop.time()))
            transport.send(encoding.encode(msgspec.structs.replace(MESSAGE, t_ns=time.monotonic_ns())))

    await asyncio.gather(*(feed(n, transport) for n, transport in enumerate(transports)))
    for transport in transports:
        await transport.close()
    stats = [transport.stats() for transport in transports]
    return Published(
        given=ticks * share,
        taken=sum(one.sent for one in stats),
        lost=sum(one.lost for one in stats),
        cpu_s=_cpu_s() - before_s,
    )


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _count(
    heard: Path, instances: int, seconds: float, published: Published, *, offset_ns: int, cpu_s: float
) -> FleetResult:
    times: Counter[tuple[str, int]] = Counter()
    late_ms = []
    for line in heard.read_text().splitlines():
        at_s, topic, payload = line.split(" ", 2)
        if topic != "ready":
            t_ns = msgspec.json.decode(payload, type=dict[str, object])["t_ns"]
            assert isinstance(t_ns, int)
            times[topic, t_ns] += 1
            late_ms.append(1e3 * (float(at_s) - (t_ns + offset_ns) / 1e9))
    p50, p99, most = np.percentile(late_ms, [50, 99, 100])
    return FleetResult(
        instances=instances,
        seconds=seconds,
        published=published,
        heard=len(times),
        twice=times.total() - len(times),
        latency_ms=(float(p50), float(p99), float(most)),
        broker_cpu_s=cpu_s,
    )


def table_of(result: FleetResult) -> str:
    """For people."""
    published = result.published
    share = published.cpu_s / (result.seconds * result.instances)
    p50, p99, most = result.latency_ms
    rows = [
        ("instances x rate x time", f"{result.instances} x {RATE_HZ:g} Hz x {result.seconds:g} s"),
        ("given to the outputs", f"{published.given}"),
        ("taken by the broker (QoS 1)", f"{published.taken}"),
        ("lost by the outputs' count", f"{published.lost}"),
        ("heard by the subscriber", f"{result.heard}, missing {result.missing}, twice {result.twice}"),
        ("sample to subscriber", f"p50 {p50:.1f} ms, p99 {p99:.1f} ms, max {most:.1f} ms"),
        ("processor, an instance", f"{100 * share:.2f} % of a core, {1e6 * share / RATE_HZ:.0f} us a message"),
        ("processor, the broker", f"{100 * result.broker_cpu_s / result.seconds:.0f} % of a core"),
    ]
    return "\n".join(f"{name:28} {value}" for name, value in rows)


if __name__ == "__main__":
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    print(table_of(run_fleet(wanted, seconds=float(sys.argv[2]) if len(sys.argv) > 2 else 20.0)))
