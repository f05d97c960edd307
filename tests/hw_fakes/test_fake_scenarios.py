"""The worlds opened by name."""

from __future__ import annotations

import numpy as np
import pytest

from hw_fakes import open_fake, scenarios
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import SettingsError
from quavelet.core.units import NS_PER_S


@pytest.mark.parametrize("which", scenarios.MOTIONS)
def test_each_name_opens_a_sleeping_chip_with_its_truth(which):
    clock = VirtualClock(start_ns=77 * NS_PER_S)
    bus = open_fake(which, clock=clock)
    chip = bus.targets[0x68]
    assert bus.name == f"fake:{which}"
    assert bus.write_read(0x68, b"\x6b", 1) == b"\x40"
    assert chip.world_time_s(77 * NS_PER_S) == 0
    assert chip.motion is scenarios.MOTIONS[which]


@pytest.mark.parametrize("which", ["", "stil", "Still", "count"])
def test_unknown_name_lists_the_names(which):
    with pytest.raises(SettingsError, match=r"fake:still, fake:tilt, fake:turntable, fake:sway, fake:counts:FILE\.npz"):
        open_fake(which, clock=VirtualClock())


def test_chip_is_as_imperfect_as_a_bought_one():
    clock = VirtualClock()
    bus = open_fake("still", clock=clock)
    bus.write(0x68, b"\x6b\x01")
    bus.write(0x68, b"\x1a\x03")
    assert bus.targets[0x68].true_rate_hz() == pytest.approx(1007)
    clock.advance_ns(NS_PER_S)
    words = np.frombuffer(bus.write_read(0x68, b"\x3b", 14), dtype=">i2")
    assert words[4] / 131 == pytest.approx(4.5, abs=0.5)


def test_two_openings_give_the_same_bytes():
    def opening():
        clock = VirtualClock()
        bus = open_fake("sway", clock=clock)
        for register, value in ((0x6B, 1), (0x1A, 3), (0x23, 0xF8), (0x6A, 0x40)):
            bus.write(0x68, bytes([register, value]))
        clock.advance_ns(NS_PER_S)
        return bus.write_read(0x68, b"\x74", 1024)

    assert opening() == opening()
