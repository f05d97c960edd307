"""The register table and the configuration table, against the fake chip's own and against what its registers hold."""

from __future__ import annotations

from itertools import combinations

import pytest
from chip_rig import ADDRESS, Rig
from hypothesis import given, settings
from hypothesis import strategies as st

from hw_fakes.chip import registers as theirs
from hw_fakes.chip.personalities import MPU6050 as MPU6050_CHIP
from hw_fakes.chip.personalities import MPU6500 as MPU6500_CHIP
from quavelet.mpu6050 import registers as ours
from quavelet.mpu6050.config import ChipConfig, configuration_table
from quavelet.mpu6050.variants import MPU6050

FIELDS = [value for value in vars(ours).values() if isinstance(value, ours.Field)]
THEIR_NAMES = {
    "PRODUCT_ID": "PRODUCT_ID",
    "SELF_TEST": "SELF_TEST_X",
    "SMPLRT_DIV": "SMPLRT_DIV",
    "CONFIG": "CONFIG",
    "GYRO_CONFIG": "GYRO_CONFIG",
    "ACCEL_CONFIG": "ACCEL_CONFIG",
    "ACCEL_CONFIG_2": "FF_THR",  # at one address, in two families
    "LP_ACCEL_ODR": "LP_ACCEL_ODR",
    "MOT_THR": "MOT_THR",
    "FIFO_EN": "FIFO_EN",
    "INT_PIN_CFG": "INT_PIN_CFG",
    "INT_ENABLE": "INT_ENABLE",
    "INT_STATUS": "INT_STATUS",
    "ACCEL_OUT": "ACCEL_XOUT_H",
    "SIGNAL_PATH_RESET": "SIGNAL_PATH_RESET",
    "MOT_DETECT_CTRL": "MOT_DETECT_CTRL",
    "ACCEL_INTEL_CTRL": "ACCEL_INTEL_CTRL",
    "USER_CTRL": "USER_CTRL",
    "PWR_MGMT_1": "PWR_MGMT_1",
    "PWR_MGMT_2": "PWR_MGMT_2",
    "FIFO_COUNT": "FIFO_COUNTH",
    "FIFO_R_W": "FIFO_R_W",
    "WHO_AM_I": "WHO_AM_I",
}
# Data sheet numbers of those the fake has no name for.
NUMBERS = {
    "MOT_DUR": 0x20,
    "I2C_MST_CTRL": 0x24,
    "TEMP_OUT": 0x41,
    "GYRO_OUT": 0x43,
    "EXT_SENS_DATA": 0x49,
    "GYRO_SELF_TEST_6500": 0x00,
    "ACCEL_SELF_TEST_6500": 0x0D,
}
WORDS = {
    "ACCEL_OFFSETS": MPU6050_CHIP.accel_offsets,
    "ACCEL_OFFSETS_6500": MPU6500_CHIP.accel_offsets,
    "GYRO_OFFSETS": tuple(theirs.GYRO_OFFSETS + 2 * axis for axis in range(3)),
}
BITS = {
    "FIFO_MODE": "FIFO_MODE",
    "GYRO_STANDBY": "GYRO_STANDBY",
    "USER_FIFO_EN": "USER_FIFO_EN",
    "USER_I2C_MST_EN": "USER_I2C_MST_EN",
    "USER_FIFO_RESET": "USER_FIFO_RESET",
    "INT_RD_CLEAR": "INT_RD_CLEAR",
    "INT_LEVEL": "INT_LEVEL",
    "LATCH_INT_EN": "LATCH_INT_EN",
    "DATA_RDY_INT": "DATA_RDY_INT",
    "MOT_INT": "MOT_INT",
    "CYCLE": "CYCLE",
    "FIFO_OFLOW_INT": "FIFO_OFLOW_INT",
    "DEVICE_RESET": "DEVICE_RESET",
    "SLEEP": "SLEEP",
    "TEMP_DIS": "TEMP_DIS",
    "CLKSEL": "CLKSEL",
}


def test_every_address_is_that_of_an_independent_table():
    mine = {name: value for name, value in vars(ours).items() if isinstance(value, ours.Register)}
    assert set(mine) == {*THEIR_NAMES, *NUMBERS}
    assert {name: r.address for name, r in mine.items()} == {
        **{name: getattr(theirs, other) for name, other in THEIR_NAMES.items()},
        **NUMBERS,
    }
    words = {name: tuple(r.address for r in getattr(ours, name)) for name in WORDS}
    assert words == WORDS
    assert set(ours.REGISTERS) == {*mine.values(), *(r for name in WORDS for r in getattr(ours, name))}


def test_every_bit_mask_is_that_of_an_independent_table():
    assert {name: getattr(ours, name).mask for name in BITS} == {n: getattr(theirs, o) for n, o in BITS.items()}


def test_reset_values_are_what_a_chip_reads_after_power_up():
    bus = Rig().fake_bus
    for register in ours.REGISTERS:
        if register.reset is not None and not register.class_6500:
            read = bus.write_read(ADDRESS, bytes([register.address]), register.length)
            assert read == bytes([register.reset]) * register.length, register.name


@pytest.mark.parametrize("class_6500", [False, True])
def test_registers_lie_in_the_register_file_and_beside_one_another(class_6500):
    only_6050 = {*ours.ACCEL_OFFSETS, ours.PRODUCT_ID, ours.SELF_TEST, ours.MOT_DETECT_CTRL}
    its_own = [r for r in ours.REGISTERS if (r not in only_6050 if class_6500 else not r.class_6500)]
    held = [address for r in its_own for address in range(r.address, r.address + r.length)]
    assert len(set(held)) == len(held)
    assert 0 <= min(held) <= max(held) < theirs.COUNT


def test_every_register_has_a_page_or_says_where_it_is_known_from():
    assert [r.name for r in ours.REGISTERS if not (r.page > 0 or r.known_from)] == []


@pytest.mark.parametrize("field", FIELDS, ids=lambda f: f"{f.register.name}.{f.name}")
def test_field_lies_inside_its_register_and_takes_its_whole_range(field):
    assert 7 >= field.high >= field.low >= 0
    top = 2 ** (field.high - field.low + 1) - 1
    assert field.mask == sum(1 << bit for bit in range(field.low, field.high + 1))
    assert {field.decode(field.encode(value) | ~field.mask & 0xFF) for value in range(top + 1)} == set(range(top + 1))
    for value in (-1, top + 1):
        with pytest.raises(ValueError, match=field.name):
            field.encode(value)


@pytest.mark.parametrize("k", [-1, 2])
def test_byte_outside_a_run_of_registers_is_refused(k):
    with pytest.raises(ValueError, match="XA_OFFS"):
        ours.ACCEL_OFFSETS[0].byte(k)


def test_fields_of_one_register_do_not_share_bits():
    assert ours.STANDBY.mask == ours.LP_WAKE_CTRL.mask | ours.STBY_ACCEL.mask | ours.STBY_GYRO.mask
    parts = [field for field in FIELDS if field is not ours.STANDBY]
    shared = [(a.name, b.name) for a, b in combinations(parts, 2) if a.register == b.register and a.mask & b.mask]
    assert shared == []


@given(
    gyro=st.sampled_from([250, 500, 1000, 2000]),
    accel=st.sampled_from([2, 4, 8, 16]),
    dlpf=st.integers(0, 6),
    n=st.integers(1, 256),
)
@settings(deadline=None, max_examples=150)
def test_each_setting_changes_its_own_bits_in_the_chip_and_no_others(gyro, accel, dlpf, n):
    """A low-pass setting written into EXT_SYNC_SET (as another driver did for years) fails here."""
    base = 1000
    if dlpf == 0:
        base, n = 8000, max(n, 8)
    rig = Rig(ChipConfig(gyro_range_dps=gyro, accel_range_g=accel, dlpf=dlpf, sample_rate_hz=base / n)).start()
    held = rig.chip.registers
    assert held[0x19] == n - 1
    assert held[0x1A] == dlpf
    assert held[0x1B] == {250: 0x00, 500: 0x08, 1000: 0x10, 2000: 0x18}[gyro]
    assert held[0x1C] == {2: 0x00, 4: 0x08, 8: 0x10, 16: 0x18}[accel]
    assert held[0x23] == 0xF8
    assert held[0x37] & 0x10 == 0
    assert held[0x38] == 0x10
    assert held[0x6A] == 0x40
    assert held[0x6B] == 0x01
    assert held[0x6C] == 0x00
    assert rig.chip.true_rate_hz() == pytest.approx(base / n * 1.007)


def test_configuration_does_not_touch_factory_trim():
    untouched = Rig()
    trim = bytes(untouched.chip.registers[0x06:0x0C] + untouched.chip.registers[0x0D:0x11])
    chip = Rig().start().chip
    assert bytes(chip.registers[0x06:0x0C] + chip.registers[0x0D:0x11]) == trim
    assert not {register for register, _ in chip.written} & {*range(0x06, 0x0C), *range(0x0D, 0x11)}


@given(st.integers(0, 255))
def test_row_sets_and_clears_its_bits_and_leaves_the_others(byte):
    chip_config = ChipConfig(gyro_range_dps=1000, accel_range_g=8, dlpf=2, sample_rate_hz=250)
    for row in configuration_table(chip_config, variant=MPU6050):
        after = row.applied_to(byte)
        assert row.holds(after)
        assert after & ~(row.set_bits | row.clear_bits) == byte & ~(row.set_bits | row.clear_bits)
        assert row.holds(byte) == (after == byte)
        assert not row.set_bits & row.clear_bits
