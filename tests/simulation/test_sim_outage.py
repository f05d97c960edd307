"""The wires come off while the board moves: what is lost is said, and the attitude is right again soon after."""

from __future__ import annotations

import numpy as np
import pytest
from session import run_session

from hw_fakes import NOISE_ONLY, FakeBus, FakeMpu6050, Tilt
from quavelet.core.blocks import Flag
from quavelet.core.clock import VirtualClock
from quavelet.core.units import NS_PER_S
from quavelet.settings import Settings


class LooseWires(FakeBus):
    """The lines are off from `off_s` for `outage_s`."""

    off_s = 12.0
    outage_s = 0.0

    def write(self, address: int, data: bytes) -> None:
        self._move_the_wires(address)
        super().write(address, data)

    def write_read(self, address: int, data: bytes, n: int) -> bytes:
        self._move_the_wires(address)
        return super().write_read(address, data, n)

    def _move_the_wires(self, address: int) -> None:
        since_s = self.clock.now_ns() / NS_PER_S - self.off_s
        chip = self.targets[address]
        if 0.0 <= since_s < self.outage_s:
            chip.unplug()
        else:
            chip.plug()


@pytest.mark.parametrize("outage_s", [0.05, 0.3, 0.9, 1.5, 5.0])
def test_the_attitude_is_right_again_two_seconds_after_an_outage(outage_s, capsys):
    clock = VirtualClock()
    chip = FakeMpu6050(clock, motion=Tilt(), imperfections=NOISE_ONLY, pll_error=0.01)
    bus = LooseWires({0x68: chip}, clock=clock, name="fake:loose")
    bus.outage_s = outage_s
    run = run_session(bus, clock, Settings(), seconds=30.0)
    block, error_deg = run.attitude, run.tilt_error_deg()
    gaps = np.flatnonzero(block.flags & Flag.GAP)
    # What is over before ten drains have failed waits in the FIFO.
    assert len(gaps) == (0 if outage_s < 0.1 else 1)
    assert (block.flags[gaps] & Flag.CHIP_UPSET).all()
    end_s = LooseWires.off_s + outage_s
    seconds = block.t_ns / NS_PER_S
    lost_s = block.gap_ns.sum() / NS_PER_S
    with capsys.disabled():
        after = error_deg[seconds > end_s]
        print(f"\nwires off for {outage_s} s: {lost_s:.3f} s of samples lost, tilt off by {after.max():.2f} deg")
        print(f"at worst, {error_deg[seconds > end_s + 2.0].max():.2f} deg from two seconds later on")
    assert lost_s == pytest.approx(run.imu.health.samples_lost / chip.true_rate_hz(), rel=0.01, abs=0.01)
    assert error_deg[seconds > end_s + 2.0].max() < 1.0
    assert not (block.flags[-1] & Flag.SETTLING)
    if outage_s > 1.0:
        assert (block.flags[(seconds > end_s) & (seconds < end_s + 0.5)] & Flag.SETTLING).all()
