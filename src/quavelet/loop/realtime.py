"""Real-time settings of the loop's thread and its process: tried, reported, and undone at the end.

What each was worth to the lateness of wake-ups: `cpu_dma_latency` halves the median on an idle machine (the
processor no longer has to come out of deep sleep); `priority` takes p99 from a millisecond to below 0.1 ms on
a loaded one; `switch_interval` bounds the wait for an output that computes in Python, whatever the priority:
beside two that never pause most deadlines at 200 Hz were missed at Python's 5 ms, none at 0.1 ms;
`timer_slack` takes the usual 50 us off every sleep where there is no real-time priority.
`lock_memory` and `tune_gc` made no difference that can be told from noise; they guard against rare long stops.
"""

from __future__ import annotations

import gc
import logging
import os
import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Self

from quavelet.loop.kernel import DMA_LATENCY_PATH, Kernel
from quavelet.settings import LoopSettings

_log = logging.getLogger(__name__)

GC_THRESHOLD = 10_000
"""New containers alive before the collector looks at them: below half a millisecond of work on a PC."""

SWITCH_INTERVAL_S = 100e-6
"""How long another Python thread may go on computing once the loop wants the interpreter."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What became of one setting: `name` as in LoopSettings, whether it is `done`, and how or why not."""

    name: str
    done: bool
    detail: str


class Realtime:
    """The settings in force; `close`, or leaving the context, undoes them. Use both on the loop's thread."""

    def __init__(self, report: tuple[Setting, ...], undo: ExitStack) -> None:
        self.report = report
        """One entry for each setting that was asked for, in the order they were tried."""
        self._undo = undo

    def close(self) -> None:
        """Undo all that was done, last first; once is enough. What cannot be undone is logged."""
        self._undo.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def apply_realtime(settings: LoopSettings, *, kernel: Kernel | None = None) -> Realtime:
    """Try each setting for the calling thread or its process, and report what became of it.

    A setting that is refused is reported, never raised. Call it on the thread that will run the loop;
    threads started afterwards do not inherit the priority.
    """
    kernel = kernel or Kernel()
    steps: list[tuple[str, bool, Callable[[], tuple[str, Callable[[], None]]], str]] = [
        ("tune_gc", settings.tune_gc, _tune_gc, ""),
        ("switch_interval", settings.switch_interval, _switch_interval, ""),
        ("lock_memory", settings.lock_memory, lambda: _lock_memory(kernel), _LOCK_HELP),
        ("timer_slack", settings.timer_slack, lambda: _timer_slack(kernel), ""),
        ("cpu_dma_latency", settings.cpu_dma_latency, lambda: _dma_latency(kernel), _DMA_HELP),
        # Last, so that the thread is not yet real-time while it is busy with the others.
        ("priority", settings.priority > 0, lambda: _priority(kernel, settings.priority), _priority_help(settings)),
    ]
    report: list[Setting] = []
    undo = ExitStack()
    for name, wanted, step, advice in steps:
        if not wanted:
            continue
        if sys.platform != "linux" and name not in _PYTHONS_OWN:
            report.append(Setting(name, False, "only Linux has it"))
            continue
        try:
            detail, back = step()
        except OSError as error:
            reason = error.strerror or str(error)
            report.append(Setting(name, False, f"{reason}; {advice}" if advice else reason))
            continue
        undo.callback(_undo, name, back)
        report.append(Setting(name, True, detail))
    return Realtime(tuple(report), undo)


_PYTHONS_OWN = ("tune_gc", "switch_interval")
_LOCK_HELP = "needs LimitMEMLOCK=infinity in the unit or CAP_IPC_LOCK"
_DMA_HELP = f"needs write permission on {DMA_LATENCY_PATH}: a udev rule, and DeviceAllow in the unit"


def _priority_help(settings: LoopSettings) -> str:
    return f"needs LimitRTPRIO={settings.priority} in the unit or CAP_SYS_NICE"


def _undo(name: str, back: Callable[[], None]) -> None:
    try:
        back()
    except OSError as error:
        _log.warning("%s could not be undone: %s", name, error)


def _tune_gc() -> tuple[str, Callable[[], None]]:
    before = gc.get_threshold()
    gc.collect()
    gc.freeze()
    gc.set_threshold(max(GC_THRESHOLD, before[0]) if before[0] else 0, *before[1:])

    def back() -> None:
        gc.set_threshold(*before)
        gc.unfreeze()

    return f"{gc.get_freeze_count()} objects frozen, threshold {gc.get_threshold()[0]}", back


def _switch_interval() -> tuple[str, Callable[[], None]]:
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(min(before_s, SWITCH_INTERVAL_S))
    return f"{sys.getswitchinterval() * 1e6:g} us, was {before_s * 1e6:g} us", lambda: sys.setswitchinterval(before_s)


def _lock_memory(kernel: Kernel) -> tuple[str, Callable[[], None]]:
    if not kernel.may_lock_all_memory():
        # It would succeed and make later allocations fail, wherever they happen to be.
        raise PermissionError(0, "the limit on locked memory is finite")
    kernel.lock_memory()
    return "pages stay in memory once touched", kernel.unlock_memory


def _timer_slack(kernel: Kernel) -> tuple[str, Callable[[], None]]:
    before_ns = kernel.timer_slack_ns()
    kernel.set_timer_slack_ns(1)
    return f"1 ns, was {before_ns} ns", lambda: kernel.set_timer_slack_ns(before_ns)


def _dma_latency(kernel: Kernel) -> tuple[str, Callable[[], None]]:
    fd = kernel.hold_dma_latency(0)
    return f"0 us held on {DMA_LATENCY_PATH}", lambda: os.close(fd)


def _priority(kernel: Kernel, priority: int) -> tuple[str, Callable[[], None]]:
    policy, before = kernel.scheduler()
    # Without the flag every thread started later, those of the hub's sinks too, would be real-time.
    kernel.set_scheduler(os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, priority)

    def back() -> None:
        try:
            kernel.set_scheduler(policy, before)
        except PermissionError:
            # Without CAP_SYS_NICE the flag cannot be taken off again; it changes nothing without priority.
            kernel.set_scheduler(policy | os.SCHED_RESET_ON_FORK, before)

    return f"SCHED_FIFO {priority}", back
