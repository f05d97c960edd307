"""The worlds opened by name."""

from __future__ import annotations

import numpy as np
import pytest

from hw_fakes import open_fake, scenarios
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import SettingsError
from quavelet.core.quaternion import angle_between
from quavelet.core.units import NS_PER_S
from quavelet.imu import open_imu


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
    with pytest.raises(SettingsError) as refused:
        open_fake(which, clock=VirtualClock())
    names = "still", "tilt", "turntable", "sway", "faces", "coning", "walk", "drone", "show", "bench"
    names = *names, "motion:FILE.npz", "counts:FILE.npz"
    assert str(refused.value).endswith(", ".join(f"fake:{name}" for name in names))


def test_chip_is_as_imperfect_as_a_bought_one():
    clock = VirtualClock()
    bus = open_fake("still", clock=clock)
    bus.write(0x68, b"\x6b\x01")
    bus.write(0x68, b"\x1a\x03")
    assert bus.targets[0x68].true_rate_hz() == pytest.approx(1007)
    clock.advance_ns(NS_PER_S)
    words = np.frombuffer(bus.write_read(0x68, b"\x3b", 14), dtype=">i2")
    assert words[4] / 131 == pytest.approx(4.5, abs=0.5)


@pytest.mark.parametrize("which", scenarios.MOTIONS)
def test_no_motion_leaves_the_narrowest_gyro_range_or_the_4_g_range(which):
    clock = VirtualClock()
    bus = open_fake(which, clock=clock)
    for register, value in ((0x6B, 1), (0x19, 4), (0x1A, 1), (0x1C, 0x08), (0x23, 0x78), (0x6A, 0x40)):
        bus.write(0x68, bytes([register, value]))
    parts = []
    for _ in range(60 * 5):
        clock.advance_ns(NS_PER_S // 5)
        waiting = int.from_bytes(bus.write_read(0x68, b"\x72", 2), "big") // 12
        parts.append(bus.write_read(0x68, b"\x74", 12 * waiting))
    counts = np.frombuffer(b"".join(parts), dtype=">i2")
    assert len(counts) > 6 * 60 * 195
    assert np.abs(counts.astype(int)).max() < 32767


def test_the_board_that_is_shown_is_drawn_another_way_than_it_lies():
    clock = VirtualClock()
    with open_imu("fake:show", clock=clock) as imu:
        messages = [m for m in imu.messages(until_ns=50 * NS_PER_S) if m.t_ns > 8 * NS_PER_S]
        truth = imu.bus.attitude(np.array([m.t_ns for m in messages]))
    off_deg = np.degrees(angle_between(truth, np.array([m.q for m in messages])))
    assert off_deg.max() < 1.0
    assert {m.still for m in messages} == {True, False}


def test_two_openings_give_the_same_bytes():
    def opening():
        clock = VirtualClock()
        bus = open_fake("sway", clock=clock)
        for register, value in ((0x6B, 1), (0x1A, 3), (0x23, 0xF8), (0x6A, 0x40)):
            bus.write(0x68, bytes([register, value]))
        clock.advance_ns(NS_PER_S)
        return bus.write_read(0x68, b"\x74", 1024)

    assert opening() == opening()
