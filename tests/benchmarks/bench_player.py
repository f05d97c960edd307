"""bench_player.py FILE [HOURS]: make a recording so long at 200 Hz (once), go through it, seek in it; figures.

A process of its own, so that the memory is that of the player.
"""

import os
import random
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path

from quavelet.bus.open import open_bus
from quavelet.core.clock import MonotonicClock, VirtualClock
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.source import ChipSource
from quavelet.mpu6050.stream import StreamInfo
from quavelet.pipeline import build_pipeline
from quavelet.recording.player import Played, Player
from quavelet.recording.writer import RecordingWriter
from quavelet.settings import Settings, parse_settings

SETTINGS = parse_settings({"bus": {"name": "fake:turntable"}}, where="bench")
DRAIN_NS = 10 * NS_PER_MS
MINUTE_DRAINS = 6000
SEEKS = 25


def drains_of(settings: Settings, n: int) -> tuple[StreamInfo, list[Drain]]:
    """What `n` looks at the fake chip gave, 10 ms apart."""
    clock, infos, drains = VirtualClock(), list[StreamInfo](), list[Drain]()
    with open_bus(settings.bus.name, clock=clock) as bus:
        source = ChipSource(
            bus,
            address=0x68,
            config=settings.chip,
            clock=clock,
            health=Health(),
            on_stream=infos.append,
            on_drain=drains.append,
        )
        source.wait_until_streaming()
        for _ in range(n):
            clock.advance_ns(DRAIN_NS)
            source.read()
    return infos[0], drains


def repeated(drains: list[Drain], by_ns: int) -> Iterator[Drain]:
    """The same again and again, each time as much later."""
    for turn in count():
        for drain in drains:
            t_ns = turn * by_ns
            yield replace(
                drain,
                seq=turn * len(drains) + drain.seq - drains[0].seq,
                before_ns=drain.before_ns + t_ns,
                after_ns=drain.after_ns + t_ns,
            )


def make(path: Path, hours: float) -> None:
    """The minute again and again: on the turntable one looks as the other."""
    info, drains = drains_of(SETTINGS, MINUTE_DRAINS)
    by_ns = drains[-1].after_ns - drains[0].after_ns + DRAIN_NS
    with RecordingWriter(path, settings=SETTINGS, overwrite=True) as writer:
        writer.begin(info)
        for drain in repeated(drains, by_ns):
            if drain.after_ns - drains[0].after_ns > hours * 3600 * NS_PER_S:
                break
            writer.write(drain)


def resident_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> None:
    path, hours = Path(sys.argv[1]), float(sys.argv[2]) if len(sys.argv) > 2 else 1.0
    if not path.exists():
        make(path, hours)
    begin_mb = resident_mb()
    given: list[Played] = []
    player = Player(path, make_pipeline=partial(build_pipeline, SETTINGS), clock=MonotonicClock(), give=given.append)
    begin_s, begin_cpu_s = time.monotonic(), time.process_time()
    while player.first_pass.step():
        pass
    pass_s, pass_cpu_s = time.monotonic() - begin_s, time.process_time() - begin_cpu_s
    player.pause()
    rng, took, took_cpu = random.Random(1), [], []
    for _ in range(SEEKS):
        given.clear()
        player.seek(rng.uniform(0, player.state().length_s))
        begin_s, begin_cpu_s = time.monotonic(), time.process_time()
        while player.state().wanted_s is not None:
            player.step()
        took.append(time.monotonic() - begin_s)
        took_cpu.append(time.process_time() - begin_cpu_s)
    overview, kept = player.overview(), player.first_pass.checkpoints
    print(
        f"{player.state().length_s:.0f} s of {path.stat().st_size / 1e6:.1f} MB: first pass {pass_s:.1f} s "
        f"({pass_cpu_s:.1f} s of a core), {len(kept)} checkpoints {kept.step_ns / NS_PER_S:g} s apart, "
        f"{len(overview.t_s)} points and {len(overview.gaps)} gaps in the overview\n"
        f"{SEEKS} seeks: {sorted(took)[SEEKS // 2]:.2f} s median, {max(took):.2f} s at most "
        f"({sorted(took_cpu)[SEEKS // 2]:.2f} s and {max(took_cpu):.2f} s of a core)\n"
        f"memory +{resident_mb() - begin_mb:.1f} MB over {begin_mb:.1f} MB before"
    )


if __name__ == "__main__":
    main()
