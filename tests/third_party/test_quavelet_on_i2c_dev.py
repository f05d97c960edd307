"""quavelet's own program, as installed, on the fake as /dev/i2c-1: the same system calls as on a Pi, in real time."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sysconfig
from pathlib import Path

import numpy as np
import pytest

from hw_fakes import NOISE_ONLY, FakeMpu6050, Tilt
from hw_fakes.ways.preload import served_device
from hw_fakes.wire.adapter import Adapter
from hw_fakes.world.motion import Motion
from quavelet.core.clock import MonotonicClock
from quavelet.core.quaternion import inclination_between

PROGRAM = Path(sysconfig.get_path("scripts"), "quavelet")

pytestmark = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="no C compiler: apt install gcc libc6-dev"
)


def check(motion: Motion, *, seconds: float) -> None:
    # The monotonic clock is the same in both processes, so a message's time is a time of the fake world.
    adapter = Adapter()
    with served_device(adapter) as environment:
        # Its world begins here: before the board moves the program must have started, and seen it still.
        chip = FakeMpu6050(MonotonicClock(), motion=motion, imperfections=NOISE_ONLY)
        adapter.attach(0x68, chip)
        done = subprocess.run(
            [PROGRAM, "run", "--bus", "linux:1", "--json", "--duration", str(seconds)],
            env={**os.environ, **environment},
            capture_output=True,
            text=True,
            timeout=seconds + 60,
            check=False,
        )
    assert done.returncode == 0, done.stderr
    (samples,) = re.findall(r"(\d+) samples from linux:1, 0 lost in 0 gaps", done.stderr) or [done.stderr]
    assert int(samples) > 180 * seconds
    messages = [json.loads(line) for line in done.stdout.splitlines()]
    assert {m["src"] for m in messages} == {"linux:1"}
    settled = [m for m in messages if "settling" not in m["flags"]]
    assert len(settled) > len(messages) / 2
    t_s = np.array([chip.world_time_s(m["t_ns"]) for m in settled])
    error_deg = np.degrees(inclination_between(motion.attitude(t_s), np.array([m["q"] for m in settled])))
    assert error_deg.max() < 0.5
    print(f"{samples} samples, {len(settled)} messages, error {error_deg.max():.3f} deg at most")


def test_quavelet_loses_a_sample_or_the_attitude_on_its_own_fake() -> None:
    check(Tilt(start_s=6.0), seconds=9.0)


@pytest.mark.slow
def test_quavelet_loses_a_sample_within_a_minute() -> None:
    check(Tilt(start_s=6.0), seconds=60.0)
