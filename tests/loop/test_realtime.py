"""The report of the real-time settings is true, whether the kernel grants them or not, and all is undone.

What touches this process for real runs in a child, and asks the kernel itself what is in force. A machine that
refuses a setting passes as well, as long as the report says so.
"""

import errno
import gc
import json
import logging
import os
import subprocess
import sys
from typing import Any

import pytest

from quavelet.core.errors import SettingsError
from quavelet.loop.kernel import Kernel
from quavelet.loop.realtime import apply_realtime
from quavelet.settings import LoopSettings

CHILD = """
import gc, json, os, resource, struct, sys, threading
from pathlib import Path
from quavelet.loop.realtime import apply_realtime
from quavelet.settings import LoopSettings

def now():
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    try:
        fd = os.open("/dev/cpu_dma_latency", os.O_RDONLY)
        latency_us = struct.unpack("=i", os.read(fd, 4))[0]
        os.close(fd)
    except OSError:
        latency_us = None
    child = []
    thread = threading.Thread(target=lambda: child.append(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK))
    thread.start()
    thread.join()
    return {
        "policy": os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK,
        "priority": os.sched_getparam(0).sched_priority,
        "thread_policy": child[0],
        "slack_ns": int(Path("/proc/self/timerslack_ns").read_text()),
        "locked_kb": int(status["VmLck"].split()[0]),
        "latency_us": latency_us,
        "frozen": gc.get_freeze_count() > 0,
        "threshold": gc.get_threshold()[0],
        "gc": gc.isenabled(),
        "switch_us": round(sys.getswitchinterval() * 1e6),
        "files": len(os.listdir("/proc/self/fd")),
    }

now()
try:
    exec(sys.argv[2])
except OSError:
    sys.exit(77)
before = now()
with apply_realtime(LoopSettings(**json.loads(sys.argv[1]))) as realtime:
    during = now()
report = {s.name: [s.done, s.detail] for s in realtime.report}
print(json.dumps({"before": before, "during": during, "after": now(), "report": report}))
"""

ALL = ["tune_gc", "switch_interval", "lock_memory", "timer_slack", "cpu_dma_latency", "priority"]
BECOME_NOBODY = """
for limit in (resource.RLIMIT_MEMLOCK, resource.RLIMIT_RTPRIO):
    resource.setrlimit(limit, (0, 0))
os.setgroups([])
os.setresgid(65534, 65534, 65534)
os.setresuid(65534, 65534, 65534)
"""
CANNOT_PREPARE = 77

linux = pytest.mark.skipif(sys.platform != "linux", reason="the settings are Linux's")
root = pytest.mark.skipif(sys.platform != "linux" or os.geteuid() != 0, reason="only root can become nobody")


def child(settings: dict[str, Any], prepare: str = "") -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-c", CHILD, json.dumps(settings), prepare], capture_output=True, text=True, timeout=60
    )
    if done.returncode == CANNOT_PREPARE:
        pytest.skip("this root may not become nobody")
    assert done.returncode == 0, done.stderr
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


@linux
def test_the_report_agrees_with_what_the_kernel_says_and_all_is_undone() -> None:
    answer = child({})
    during, report = answer["during"], answer["report"]
    assert list(report) == ALL
    assert (during["policy"] == os.SCHED_FIFO) == report["priority"][0]
    assert during["priority"] == (50 if report["priority"][0] else 0)
    assert (during["locked_kb"] > 0) == report["lock_memory"][0]
    if report["cpu_dma_latency"][0]:
        assert during["latency_us"] == 0
    # Newer kernels say 0 for a real-time thread, which has no slack at all.
    assert (during["slack_ns"] <= 1) == report["timer_slack"][0]
    assert during["frozen"] and during["threshold"] == 10_000
    assert during["switch_us"] == 100
    assert answer["after"] == answer["before"]


@linux
def test_timer_slack_is_a_nanosecond_where_the_thread_is_not_real_time() -> None:
    answer = child({"priority": 0})
    assert "priority" not in answer["report"]
    assert answer["report"]["timer_slack"][0]
    assert (answer["during"]["slack_ns"], answer["during"]["policy"]) == (1, os.SCHED_OTHER)
    assert answer["after"]["slack_ns"] == answer["before"]["slack_ns"] > 1


@linux
def test_threads_started_by_the_loop_s_thread_are_not_real_time() -> None:
    # They would be outputs, and would keep the loop from the processor.
    assert child({})["during"]["thread_policy"] == os.SCHED_OTHER


@linux
def test_garbage_in_cycles_is_still_collected() -> None:
    assert child({})["during"]["gc"]
    # Whoever runs without the collector on purpose keeps it off.
    off = child({}, "gc.disable(); gc.set_threshold(0)")
    assert (off["during"]["gc"], off["during"]["threshold"]) == (False, 0)


@root
def test_without_rights_each_refusal_says_what_is_needed_and_nothing_is_changed() -> None:
    answer = child({}, BECOME_NOBODY)
    report, during = answer["report"], answer["during"]
    assert {name: done for name, (done, _) in report.items()} == {
        "tune_gc": True,
        "switch_interval": True,
        "lock_memory": False,
        "timer_slack": True,
        "cpu_dma_latency": False,
        "priority": False,
    }
    assert "LimitRTPRIO=50" in report["priority"][1] and "CAP_SYS_NICE" in report["priority"][1]
    assert "LimitMEMLOCK=infinity" in report["lock_memory"][1]
    assert "/dev/cpu_dma_latency" in report["cpu_dma_latency"][1]
    assert (during["policy"], during["locked_kb"]) == (os.SCHED_OTHER, 0)
    assert answer["after"] == answer["before"]


class RefusingKernel(Kernel):
    """Refuses everything, and counts what was asked of it."""

    def __init__(self, code: int = errno.EPERM, *, memory_limited: bool = False) -> None:
        self.asked: list[str] = []
        self._code = code
        self._memory_limited = memory_limited

    def _refuse(self, what: str) -> OSError:
        self.asked.append(what)
        return OSError(self._code, os.strerror(self._code))

    def scheduler(self) -> tuple[int, int]:
        return 0, 0

    def set_scheduler(self, policy: int, priority: int) -> None:
        raise self._refuse(f"scheduler {policy & ~os.SCHED_RESET_ON_FORK} {priority}")

    def timer_slack_ns(self) -> int:
        return 50_000

    def set_timer_slack_ns(self, slack_ns: int) -> None:
        raise self._refuse(f"slack {slack_ns}")

    def may_lock_all_memory(self) -> bool:
        return not self._memory_limited

    def lock_memory(self) -> None:
        raise self._refuse("lock")

    def hold_dma_latency(self, latency_us: int) -> int:
        raise self._refuse(f"latency {latency_us}")


@linux
@pytest.mark.parametrize("code", [errno.EPERM, errno.EACCES, errno.ENOENT, errno.ENOSYS, errno.EINVAL])
def test_no_refusal_is_raised_whatever_its_kind(code: int) -> None:
    kernel = RefusingKernel(code)
    with apply_realtime(LoopSettings(tune_gc=False, switch_interval=False), kernel=kernel) as realtime:
        assert [(s.name, s.done) for s in realtime.report] == [(name, False) for name in ALL[2:]]
        assert all(os.strerror(code) in s.detail for s in realtime.report)
    # Nothing was done, so nothing may be undone.
    assert kernel.asked == ["lock", "slack 1", "latency 0", "scheduler 1 50"]


@linux
def test_memory_is_not_locked_under_a_limit_that_would_fail_later_allocations() -> None:
    kernel = RefusingKernel(memory_limited=True)
    settings = LoopSettings(priority=0, cpu_dma_latency=False, timer_slack=False, tune_gc=False, switch_interval=False)
    (setting,) = apply_realtime(settings, kernel=kernel).report
    assert not setting.done
    assert (
        setting.detail
        == "the limit on locked memory is finite; needs LimitMEMLOCK=infinity in the unit or CAP_IPC_LOCK"
    )
    assert kernel.asked == []


def test_what_is_switched_off_is_neither_tried_nor_reported() -> None:
    kernel = RefusingKernel()
    frozen = gc.get_freeze_count()
    settings = LoopSettings(
        priority=0, lock_memory=False, cpu_dma_latency=False, timer_slack=False, tune_gc=False, switch_interval=False
    )
    assert apply_realtime(settings, kernel=kernel).report == ()
    assert kernel.asked == []
    assert gc.get_freeze_count() == frozen


class StickyKernel(Kernel):
    """Grants a priority, and takes only `accepted` policies afterwards: a thread without CAP_SYS_NICE."""

    def __init__(self, accepted: set[int]) -> None:
        self.given: list[tuple[int, int]] = []
        self._accepted = accepted

    def scheduler(self) -> tuple[int, int]:
        return os.SCHED_OTHER, 0

    def set_scheduler(self, policy: int, priority: int) -> None:
        if self.given and policy not in self._accepted:
            raise PermissionError(errno.EPERM, "Operation not permitted")
        self.given.append((policy, priority))


ONLY_PRIORITY = LoopSettings(
    lock_memory=False, cpu_dma_latency=False, timer_slack=False, tune_gc=False, switch_interval=False
)


@linux
def test_a_thread_that_may_not_take_the_fork_flag_off_still_gives_its_priority_back() -> None:
    plain_with_flag = os.SCHED_OTHER | os.SCHED_RESET_ON_FORK
    kernel = StickyKernel({plain_with_flag})
    apply_realtime(ONLY_PRIORITY, kernel=kernel).close()
    assert kernel.given == [(os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, 50), (plain_with_flag, 0)]


@linux
def test_what_cannot_be_undone_is_logged_and_close_may_be_called_twice(caplog: pytest.LogCaptureFixture) -> None:
    realtime = apply_realtime(ONLY_PRIORITY, kernel=StickyKernel(set()))
    with caplog.at_level(logging.WARNING):
        realtime.close()
        realtime.close()
    assert [r.getMessage() for r in caplog.records] == [
        "priority could not be undone: [Errno 1] Operation not permitted"
    ]


@pytest.mark.parametrize("priority", [-1, 100])
def test_a_priority_out_of_range_is_refused(priority: int) -> None:
    with pytest.raises(SettingsError, match="priority"):
        LoopSettings(priority=priority)
