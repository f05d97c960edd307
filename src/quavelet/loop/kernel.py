"""What the real-time settings ask of the Linux kernel, one method a call; each raises OSError when refused."""

from __future__ import annotations

import ctypes
import os
import resource
import struct
from pathlib import Path

DMA_LATENCY_PATH = "/dev/cpu_dma_latency"

_PR_SET_TIMERSLACK = 29
_PR_GET_TIMERSLACK = 30
_MCL_CURRENT = 1
_MCL_FUTURE = 2
_MCL_ONFAULT = 4
_CAP_IPC_LOCK = 14


class Kernel:
    """The calls, for the calling thread where the kernel knows threads."""

    def scheduler(self) -> tuple[int, int]:
        """Policy (with its flags) and priority of the calling thread."""
        return os.sched_getscheduler(0), os.sched_getparam(0).sched_priority

    def set_scheduler(self, policy: int, priority: int) -> None:
        """Give the calling thread this policy and priority."""
        os.sched_setscheduler(0, policy, os.sched_param(priority))

    def timer_slack_ns(self) -> int:
        """By how much the kernel may delay the calling thread's timers."""
        return _call("prctl", _PR_GET_TIMERSLACK, 0, 0, 0, 0)

    def set_timer_slack_ns(self, slack_ns: int) -> None:
        """Let the kernel delay the calling thread's timers by at most `slack_ns` >= 1; 0 is the default again."""
        _call("prctl", _PR_SET_TIMERSLACK, slack_ns, 0, 0, 0)

    def may_lock_all_memory(self) -> bool:
        """Whether no limit will refuse an allocation once all memory is locked."""
        if resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY:
            return True
        for line in Path("/proc/thread-self/status").read_bytes().splitlines():
            if line.startswith(b"CapEff:"):
                return bool(int(line.split()[1], 16) >> _CAP_IPC_LOCK & 1)
        return False

    def lock_memory(self) -> None:
        """Keep every page of the process, present and future, in memory once it has been touched."""
        # Without ONFAULT the kernel touches all of each thread's 8 MB stack: 26 MB resident become 186 MB
        # with six threads, which a Pi Zero does not have to spare.
        _call("mlockall", _MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT)

    def unlock_memory(self) -> None:
        """Undo `lock_memory`."""
        _call("munlockall")

    def hold_dma_latency(self, latency_us: int) -> int:
        """Ask for idle states that are left within `latency_us`, for as long as the returned file stays open."""
        fd = os.open(DMA_LATENCY_PATH, os.O_WRONLY | os.O_CLOEXEC)
        try:
            os.write(fd, struct.pack("=i", latency_us))
        except OSError:
            os.close(fd)
            raise
        return fd


def _call(name: str, *arguments: int) -> int:
    """A function of the C library that gives -1 and errno on failure, all its arguments being integers."""
    libc = ctypes.CDLL(None, use_errno=True)
    function = libc[name]
    function.restype = ctypes.c_int
    # prctl is variadic and reads unsigned longs; for mlockall's int a long does as well.
    result: int = function(*(ctypes.c_ulong(a) for a in arguments))
    if result == -1:
        code = ctypes.get_errno()
        raise OSError(code, f"{name}: {os.strerror(code)}")
    return result
