"""Boards by name: what answers on the auxiliary bus of each."""

from __future__ import annotations

import numpy as np
import pytest
from magnetometer_bench import body_field_ut

from hw_fakes import FakeBus, FakeMpu6050
from hw_fakes.boards import BOARDS, board
from hw_fakes.magnetometers.base import PERFECT_MAGNETOMETER
from hw_fakes.world.motion import Still
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import BusError

LYING = Still(roll_deg=20, pitch_deg=-35, yaw_deg=130)

ANSWERS = {
    "gy-521": {},
    "gy-87": {0x0D: (0x0D, b"\xff")},
    "gy-87-hmc5883l": {0x1E: (0x0A, b"H43")},
    "mpu-9150": {0x0C: (0x00, b"\x48")},
    "mpu-9250": {0x0C: (0x00, b"\x48")},
}


def test_every_board_is_looked_at():
    assert set(ANSWERS) == set(BOARDS)


@pytest.mark.parametrize("name", list(ANSWERS))
def test_board_has_its_magnetometer_and_nothing_else_behind_it(name):
    targets = board(name).aux_targets(VirtualClock(), LYING)
    assert set(targets) == set(ANSWERS[name])
    for address, (register, expected) in ANSWERS[name].items():
        targets[address].write(bytes([register]))
        assert targets[address].read(len(expected)) == expected


@pytest.mark.parametrize(
    ("name", "who_am_i"), [("gy-521", 0x68), ("gy-87", 0x68), ("mpu-9150", 0x68), ("mpu-9250", 0x71)]
)
def test_board_has_its_chip_of_the_family(name, who_am_i):
    assert board(name).personality.who_am_i == who_am_i


@pytest.mark.parametrize("name", [name for name, answers in ANSWERS.items() if answers])
def test_master_of_the_board_finds_its_magnetometer(name):
    clock = VirtualClock()
    master = board(name).aux_master(clock, LYING)
    ((address, (register, expected)),) = ANSWERS[name].items()
    registers = bytearray(128)
    registers[0x6A] = 0x20
    registers[0x25:0x28] = bytes([0x80 | address, register, 0x80 | len(expected)])
    assert not master.sample(registers, 0, clock.now_ns())
    assert registers[0x49 : 0x49 + len(expected)] == expected


@pytest.mark.parametrize(("name", "in_package"), [("gy-87", False), ("mpu-9150", True), ("mpu-9250", True)])
def test_magnetometer_inside_the_package_has_axes_of_its_own(name, in_package):
    clock = VirtualClock()
    (chip,) = board(name).aux_targets(clock, LYING, imperfections=PERFECT_MAGNETOMETER).values()
    x, y, z = body_field_ut()
    assert np.allclose(chip.field_ut(clock.now_ns()), [y, x, -z] if in_package else [x, y, z])


def test_board_as_bought_does_not_show_the_bare_field():
    clock = VirtualClock()
    (chip,) = board("gy-87").aux_targets(clock, LYING).values()
    assert np.linalg.norm(chip.field_ut(clock.now_ns()) - body_field_ut()) > 5


def test_gy_521_has_nothing_behind_it_and_a_slave_there_is_not_acknowledged():
    master = board("gy-521").aux_master(VirtualClock(), LYING)
    registers = bytearray(128)
    registers[0x6A] = 0x20
    registers[0x25:0x28] = bytes([0x80 | 0x1E, 0x0A, 0x83])
    assert master.sample(registers, 0, 0)
    assert registers[0x36] == 0x01


def test_magnetometer_of_a_gy_87_answers_only_once_the_bypass_is_open():
    clock = VirtualClock()
    master = board("gy-87").aux_master(clock, LYING, imperfections=PERFECT_MAGNETOMETER)
    chip = FakeMpu6050(clock, motion=LYING, aux=master)
    bus = FakeBus({0x68: chip, **master.outside()}, clock=clock)
    bus.write(0x68, b"\x6b\x01")
    with pytest.raises(BusError):
        bus.write_read(0x0D, b"\x0d", 1)
    bus.write(0x68, b"\x37\x02")
    assert bus.write_read(0x0D, b"\x0d", 1) == b"\xff"
    bus.write(0x0D, b"\x09\x0d")
    clock.advance_ns(6_000_000)
    words = np.frombuffer(bus.write_read(0x0D, b"\x00", 6), dtype="<i2")
    assert np.allclose(words / 120, body_field_ut(), atol=0.01)
    bus.write(0x68, b"\x6a\x20")
    with pytest.raises(BusError):
        bus.write_read(0x0D, b"\x0d", 1)


def test_unknown_board_is_refused_with_the_names_there_are():
    with pytest.raises(ValueError, match="gy-521"):
        board("gy-99")
