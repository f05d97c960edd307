"""How much faster than real time the fake side is; printed, not asserted."""

from __future__ import annotations

import time

import pytest

from hw_fakes import open_fake, scenarios
from quavelet.core.clock import VirtualClock
from quavelet.core.units import NS_PER_MS, NS_PER_S


@pytest.mark.benchmark
@pytest.mark.parametrize(("dlpf", "div", "step_ms"), [(3, 0, 20), (6, 0, 20), (3, 9, 50), (0, 0, 4)])
@pytest.mark.parametrize("which", scenarios.MOTIONS)
def test_speed_through_the_fifo(which, dlpf, div, step_ms, capsys):
    clock = VirtualClock()
    bus = open_fake(which, clock=clock)
    for register, value in ((0x6B, 1), (0x19, div), (0x1A, dlpf), (0x23, 0xF8), (0x6A, 0x40)):
        bus.write(0x68, bytes([register, value]))
    world_s, frames, start_s = 10, 0, time.perf_counter()
    while clock.now_ns() < world_s * NS_PER_S:
        clock.advance_ns(step_ms * NS_PER_MS)
        bus.write_read(0x68, b"\x3a", 1)
        waiting = int.from_bytes(bus.write_read(0x68, b"\x72", 2), "big") // 14
        if waiting:
            bus.write_read(0x68, b"\x74", waiting * 14)
        frames += waiting
    took_s = time.perf_counter() - start_s
    with capsys.disabled():
        print(f"\nfake:{which} dlpf {dlpf}, {frames / world_s:.0f} frames/s: {world_s / took_s:.0f} times real time")
