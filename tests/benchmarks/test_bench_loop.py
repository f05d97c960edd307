"""Lateness of a 200 Hz loop's wake-ups, real-time settings off and on, beside cyclictest in the same run.

The figures are printed; only the count of deadlines is asserted, for absolute times are the machine's.
"""

import re
import shutil
import subprocess
import sys
import threading

import pytest

from quavelet.core.clock import MonotonicClock
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.loop.deadline import FixedStepLoop, LoopStats
from quavelet.loop.realtime import Setting, apply_realtime
from quavelet.settings import LoopSettings

PERIOD_NS = 5 * NS_PER_MS
DURATION_NS = 2 * NS_PER_S
OFF = LoopSettings(
    priority=0, lock_memory=False, cpu_dma_latency=False, timer_slack=False, tune_gc=False, switch_interval=False
)

pytestmark = [
    pytest.mark.benchmark,
    pytest.mark.skipif(sys.platform != "linux", reason="the settings are Linux's"),
]


class Run:
    """The loop on a thread of its own, so that no setting of one run is left for the next."""

    def __init__(self, settings: LoopSettings) -> None:
        self._settings = settings
        self._clock = MonotonicClock()
        self._end_ns = self._clock.now_ns() + DURATION_NS
        self._deadlines_ns: list[int] = []
        self._loop = FixedStepLoop(self._clock, period_ns=PERIOD_NS, tick=self._tick)
        self.report: tuple[Setting, ...] = ()
        thread = threading.Thread(target=self._run)
        thread.start()
        thread.join(60)
        self.stats: LoopStats = self._loop.stats
        self.expected = (self._end_ns - self._deadlines_ns[0]) // PERIOD_NS + 1

    def _run(self) -> None:
        with apply_realtime(self._settings) as realtime:
            self.report = realtime.report
            self._loop.run(until_ns=self._end_ns)

    def _tick(self, deadline_ns: int) -> bool:
        self._deadlines_ns.append(deadline_ns)
        return True


def cyclictest(*options: str) -> tuple[int, int] | None:
    """p50 and p99 in ns of cyclictest's own wake-ups at the same period, None where it is not installed."""
    program = shutil.which("cyclictest")
    if program is None:
        return None
    loops = str(DURATION_NS // PERIOD_NS)
    command = [program, "-q", "-m", "-i", str(PERIOD_NS // 1_000), "-l", loops, "-h", "20000", *options]
    text = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout
    sorted_us = [int(us) for us, n in re.findall(r"^(\d+) (\d+)$", text, re.MULTILINE) for _ in range(int(n))]
    return sorted_us[len(sorted_us) // 2] * 1_000, sorted_us[len(sorted_us) * 99 // 100] * 1_000


def test_lateness_with_the_real_time_settings_off_and_on(capsys: pytest.CaptureFixture[str]) -> None:
    off, on = Run(OFF), Run(LoopSettings())
    # --laptop leaves the idle states alone, as the loop without settings does.
    peers = cyclictest("--laptop", "--policy=other"), cyclictest("-p", "50")
    with capsys.disabled():
        print()
        for setting in on.report:
            print(f"  {setting.name:16} {'done' if setting.done else 'refused':8} {setting.detail}")
        for name, run, peer in (("off", off, peers[0]), ("on", on, peers[1])):
            p50_ns, p99_ns = run.stats.lateness_p50_ns, run.stats.lateness_p99_ns
            print(f"  settings {name:3}: lateness p50 {p50_ns / 1e3:.0f} us, p99 {p99_ns / 1e3:.0f} us", end="")
            print(f", max {run.stats.lateness_max_ns / 1e3:.0f} us, missed {run.stats.missed}", end="")
            if peer is None:
                print("; cyclictest is not installed (Debian: rt-tests)")
            else:
                print(f"; {p50_ns / peer[0]:.1f} and {p99_ns / peer[1]:.1f} times cyclictest's")
        ratios = (
            off.stats.lateness_p50_ns / on.stats.lateness_p50_ns,
            off.stats.lateness_p99_ns / on.stats.lateness_p99_ns,
        )
        print(f"  off / on: p50 {ratios[0]:.1f}, p99 {ratios[1]:.1f}")
    for run in (off, on):
        assert run.stats.ticks + run.stats.missed == run.expected


def test_deadlines_missed_beside_an_output_that_never_pauses(capsys: pytest.CaptureFixture[str]) -> None:
    done = threading.Event()

    def compute() -> None:
        while not done.is_set():
            sum(range(100))

    busy = [threading.Thread(target=compute) for _ in range(2)]
    for thread in busy:
        thread.start()
    try:
        runs = {us: Run(LoopSettings(switch_interval=us == 100)) for us in (5_000, 100)}
    finally:
        done.set()
        for thread in busy:
            thread.join(60)
    with capsys.disabled():
        print()
        for us, run in runs.items():
            s = run.stats
            print(f"  interpreter handed over within {us} us: {s.missed} of {run.expected} deadlines missed", end="")
            print(f", lateness p50 {s.lateness_p50_ns / 1e3:.0f} us, p99 {s.lateness_p99_ns / 1e3:.0f} us")
    for run in runs.values():
        assert run.stats.ticks + run.stats.missed == run.expected
