"""The other threads of the loop's process: kept running, so that none of them holds the loop up.

Whichever Python thread computes holds the interpreter. Where an ordinary thread is kept from the processor by other
programs meanwhile, the loop waits for the interpreter however high its own priority is: with all outputs on, on two
processors with work for eight, lateness p99 was 2 ms instead of 0.1 ms, and a message was out after 50 ms instead of
2.4 ms. So they run before all ordinary programs, and after the loop. The kernel keeps a twentieth of the processor
for the rest (sched_rt_runtime_us), should one of them never pause.
"""

from __future__ import annotations

import os
import threading

from quavelet.loop.realtime import Setting

PRIORITY = 1
"""The lowest of SCHED_FIFO; the loop's is above it."""


def keep_others_running() -> Setting:
    """Give every other thread of this process the lowest real-time priority; one that has it keeps it.

    Call it on the loop's thread. What they start themselves is ordinary. A refusal is reported, never raised.
    """
    others = [thread.native_id for thread in threading.enumerate() if thread is not threading.current_thread()]
    raised = 0
    for number in others:
        if number is None:
            continue
        try:
            os.sched_setscheduler(number, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
        except ProcessLookupError:
            continue  # It has just ended.
        except OSError as error:
            return Setting("other_threads", False, f"{error.strerror}: LimitRTPRIO of the unit must allow {PRIORITY}")
        raised += 1
    return Setting("other_threads", True, f"{raised} at SCHED_FIFO {PRIORITY}")
