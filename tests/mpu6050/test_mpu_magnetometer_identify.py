"""Which magnetometer is behind the chip, and what its owner is told where it is none that is known."""

from __future__ import annotations

import errno

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from magnetometer_rig import ADDRESS, BOARDS, CHIPS, NAMES, MagRig

from hw_fakes import Nack
from hw_fakes.chip.aux_master import Bypassed
from quavelet.bus.faults import bus_error
from quavelet.core.errors import BusError, WrongChip
from quavelet.mpu6050.magnetometer.identify import ADDRESSES, find_magnetometer
from quavelet.mpu6050.magnetometer.plan import AS_THE_CHIP, IN_PACKAGE
from quavelet.mpu6050.registers import INT_PIN_CFG

ALL = ["gy-521", *BOARDS]


class Stranger:
    """A chip that gives fixed bytes, register by register, and writes down what it is told."""

    def __init__(self, registers: dict[int, int] | None = None, *, otherwise: int = 0) -> None:
        self.registers = registers or {}
        self.otherwise = otherwise
        self.pointer = 0
        self.stored: list[bytes] = []

    def write(self, data: bytes) -> None:
        self.pointer = data[0]
        if len(data) > 1:
            self.stored.append(data)

    def read(self, n: int) -> bytes:
        answer = bytes(self.registers.get(self.pointer + i, self.otherwise) for i in range(n))
        self.pointer += n
        return answer

    def stop(self) -> None:
        return


def put_behind(rig: MagRig, address: int, target: Stranger) -> None:
    rig.bus.targets[address] = Bypassed(target, lambda: rig.aux.bypass(rig.chip.registers))


@pytest.mark.parametrize("name", BOARDS)
def test_magnetometer_of_each_board_is_told_by_its_id(name):
    rig = MagRig(name)
    finding = find_magnetometer(rig.access)
    assert finding.magnetometer is not None
    assert finding.magnetometer.name == NAMES[name]
    assert finding.magnetometer.address == CHIPS[name].address
    assert finding.magnetometer.to_body == (IN_PACKAGE if name.startswith("mpu-") else AS_THE_CHIP)
    assert not finding.sentences


def test_plain_board_is_told_to_have_none():
    finding = find_magnetometer(MagRig("gy-521").access)
    assert finding.magnetometer is None and not finding.candidates
    (sentence,) = finding.sentences
    assert "GY-521" in sentence and "0x1e" in sentence


@pytest.mark.parametrize("name", ALL)
@settings(max_examples=25)
@given(user=st.sampled_from([0x00, 0x20, 0x40, 0x60]), pin=st.integers(0, 255), asleep=st.booleans())
def test_looking_behind_the_chip_leaves_it_as_it_was(name, user, pin, asleep):
    rig = MagRig(name)
    for register, byte in ((0x37, pin), (0x6A, user), (0x6B, 0x41 if asleep else 0x01)):
        rig.bus.write(ADDRESS, bytes([register, byte]))
    before = bytes(rig.chip.registers)
    finding = find_magnetometer(rig.access)
    after = bytes(rig.chip.registers)
    ours = [*range(0x19, 0x3A), *range(0x63, 0x6D)]  # not what the sensors and their interrupts write
    assert [after[i] for i in ours if i != 0x36] == [before[i] for i in ours if i != 0x36]
    assert (finding.magnetometer is None) == (name == "gy-521")


@pytest.mark.parametrize("name", ["mpu-9150", "mpu-9250"])
@pytest.mark.parametrize("control", [0x00, 0x10, 0x01, 0x02, 0x06, 0x12, 0x16, 0x0F])
def test_the_two_of_akm_are_told_apart_in_every_mode_and_left_in_no_mode_they_were_not_in(name, control):
    rig = MagRig(name)
    rig.magnetometer.write(bytes([0x0A, control]))
    rig.magnetometer.stop()
    assert rig.found().name == NAMES[name]
    rig.magnetometer.write(b"\x0a")
    left = rig.magnetometer.read(1)[0]
    rig.magnetometer.stop()
    kept = name == "mpu-9250" and (control & 0x10 or control in (0x02, 0x06))
    assert left == (control if kept else 0)
    assert not rig.magnetometer.hasty_changes


def test_akm_of_an_mpu_9150_that_is_measuring_by_the_master_is_not_mistaken():
    rig = MagRig("mpu-9150")
    rig.master()
    for _ in range(20):
        rig.wait_ms(3.3)
        assert rig.found().name == "AK8975"


@pytest.mark.parametrize(
    ("address", "stranger", "said"),
    [
        (0x1E, Stranger(), "DA5883"),
        (0x2C, Stranger({0x00: 0x80}), "QMC5883P"),
        (0x2C, Stranger({0x00: 0x31}), "0x31"),
        (0x0D, Stranger({0x0D: 0x12}), "0x12"),
        (0x0D, Stranger(otherwise=0xFF), "pull-ups"),
        (0x0D, Stranger({0x0D: 0xFF, 0x06: 0xF8}), "pull-ups"),
        (0x0D, Stranger({0x0D: 0xFF, 0x0A: 0x3E}), "pull-ups"),
        (0x0C, Stranger({0x00: 0x47}), "0x47"),
        (0x0C, Stranger({0x00: 0x48, 0x01: 0x05}), "AK09911"),
    ],
)
def test_unknown_chip_is_named_and_never_written_to(address, stranger, said):
    rig = MagRig("gy-521")
    stranger.stored.clear()
    put_behind(rig, address, stranger)
    finding = find_magnetometer(rig.access)
    assert finding.magnetometer is None
    assert any(said in sentence and f"0x{address:02x}" in sentence for sentence in finding.sentences)
    assert not stranger.stored


@settings(max_examples=60)
@given(
    address=st.sampled_from(ADDRESSES),
    registers=st.dictionaries(st.integers(0, 0x12), st.integers(0, 255)),
    otherwise=st.sampled_from([0x00, 0xFF]),
)
def test_a_chip_is_written_to_only_once_its_id_is_right(address, registers, otherwise):
    stranger = Stranger(registers, otherwise=otherwise)
    rig = MagRig("gy-521")
    put_behind(rig, address, stranger)
    finding = find_magnetometer(rig.access)
    if stranger.stored:
        assert address == 0x0C and stranger.registers.get(0, otherwise) == 0x48
        assert finding.magnetometer is not None


def test_two_that_answer_are_left_to_the_owner_to_choose_from():
    rig = MagRig("gy-87")
    put_behind(rig, 0x1E, Stranger(dict(zip(range(10, 13), b"H43", strict=True))))
    finding = find_magnetometer(rig.access)
    assert finding.magnetometer is None
    assert {found.name for found in finding.candidates} == {"QMC5883L", "HMC5883L"}
    assert any("QMC5883L" in s and "HMC5883L" in s for s in finding.sentences)
    chosen = find_magnetometer(rig.access, wanted="HMC5883L").magnetometer
    assert chosen is not None and chosen.address == 0x1E


def test_wanted_one_that_is_not_there_is_not_exchanged_for_what_is():
    finding = find_magnetometer(MagRig("gy-87").access, wanted="HMC5883L")
    assert finding.magnetometer is None
    assert any("HMC5883L" in sentence for sentence in finding.sentences)
    with pytest.raises(ValueError, match="HMC5883L"):
        find_magnetometer(MagRig("gy-87").access, wanted="HMC5883")


def test_magnetometer_beside_the_chip_is_told_from_one_behind_it():
    rig = MagRig("gy-87")
    rig.bus.targets[0x0D] = rig.magnetometer
    finding = find_magnetometer(rig.access)
    assert finding.magnetometer is not None and finding.magnetometer.outside
    assert any("outer bus" in sentence for sentence in finding.sentences)


def test_akm_behind_a_chip_that_has_none_in_its_package_gets_no_axes_made_up():
    rig = MagRig("gy-87")
    akm = MagRig("mpu-9250").magnetometer
    del rig.bus.targets[0x0D]
    put_behind(rig, 0x0C, akm)
    finding = find_magnetometer(rig.access)
    assert finding.magnetometer is not None
    assert finding.magnetometer.to_body == AS_THE_CHIP
    assert any("to_body" in sentence for sentence in finding.sentences)


def test_clock_chip_at_the_chips_address_is_not_written_to():
    rig = MagRig("gy-87")
    clock_chip = Stranger({0x75: 0x23})
    rig.bus.targets[ADDRESS] = clock_chip
    with pytest.raises(WrongChip):
        find_magnetometer(rig.access)
    assert not clock_chip.stored


class Flaky:
    """A target whose every other message fails, as on a disturbed wire."""

    def __init__(self, target) -> None:
        self.target = target
        self.turn = 0

    def write(self, data: bytes) -> None:
        self.turn += 1
        if self.turn % 2:
            raise Nack
        self.target.write(data)

    def read(self, n: int) -> bytes:
        answer: bytes = self.target.read(n)
        return answer

    def stop(self) -> None:
        self.target.stop()


def test_one_disturbed_transfer_does_not_hide_the_magnetometer():
    rig = MagRig("gy-87-hmc5883l")
    rig.bus.targets[0x1E] = Flaky(rig.bus.targets[0x1E])
    assert rig.found().name == "HMC5883L"


def test_wires_that_fail_while_the_bypass_is_open_are_told_of_and_the_bypass_is_closed_again():
    rig = MagRig("gy-87")

    class Broken(Stranger):
        def write(self, _data: bytes) -> None:
            raise bus_error(errno.EIO, bus="fake", address=0x0C)

    put_behind(rig, 0x0C, Broken())
    with pytest.raises(BusError):
        find_magnetometer(rig.access)
    assert not rig.access.read(INT_PIN_CFG) & 0x02
