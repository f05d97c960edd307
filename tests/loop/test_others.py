"""Threads beside the loop's run before ordinary programs, for they hold the interpreter that it needs."""

import os
import sys
import threading
from pathlib import Path

import pytest

from quavelet.loop.others import PRIORITY, keep_others_running
from quavelet.settings import LoopSettings

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the settings are Linux's")


def test_other_threads_get_the_lowest_priority_and_this_one_keeps_its_own() -> None:
    end = threading.Event()
    other = threading.Thread(target=end.wait)
    other.start()
    own = os.sched_getscheduler(0)
    try:
        said = keep_others_running()
        assert other.native_id is not None
        policy = os.sched_getscheduler(other.native_id) & ~os.SCHED_RESET_ON_FORK
        if not said.done:
            assert policy == os.SCHED_OTHER
            assert "LimitRTPRIO" in said.detail
            return
        assert policy == os.SCHED_FIFO
        assert os.sched_getparam(other.native_id).sched_priority == PRIORITY < LoopSettings().priority
        assert os.sched_getscheduler(0) == own
        assert said.detail.endswith("at SCHED_FIFO 1")
    finally:
        end.set()
        other.join()
        # pytest's own threads, where it has some.
        for number in (int(path.name) for path in Path("/proc/self/task").iterdir()):
            if number != threading.get_native_id():
                os.sched_setscheduler(number, os.SCHED_OTHER, os.sched_param(0))
