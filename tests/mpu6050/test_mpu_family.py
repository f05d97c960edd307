"""Every chip of the family driven by the same source: scales, filters, FIFO, recovery, and what is said of it."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest
from chip_rig import ADDRESS, Rig, StubbornChip, config
from hypothesis import given
from hypothesis import strategies as st

from hw_fakes import NOISE_ONLY, PERFECT, Imperfections
from hw_fakes.chip import personalities as fakes
from quavelet.core.blocks import Flag
from quavelet.core.errors import ChipUnstable, SettingsError, WrongChip
from quavelet.core.health import Health
from quavelet.mpu6050.registers import FRAME_BYTES
from quavelet.mpu6050.source import ChipSource
from quavelet.mpu6050.stream import StreamInfo
from quavelet.mpu6050.variants import VARIANTS, identify
from quavelet.recording.reader import RecordingReader
from quavelet.recording.replay import ReplaySource
from quavelet.recording.writer import RecordingWriter
from quavelet.settings import Settings, parse_settings

G, DEG = 9.80665, np.pi / 180
CHIPS = {chip.name: chip for chip in fakes.PERSONALITIES}
CLASS_6500 = {name: chip for name, chip in CHIPS.items() if chip.class_6500}
# Bytes of FIFO each is to be driven with.
FIFO = {"ICM-20689": 4096, "clone-0x72": 512, "clone-0x75": 512}
# WHO_AM_I, name, degC at a word of 3400, by the data sheets and the kernel's table.
FACTS = {
    0x68: ("MPU-6050", 46.53), 0x69: ("0x69 clone", 46.53), 0x70: ("MPU-6500", 31.184), 0x71: ("MPU-9250", 31.184),
    0x72: ("0x72 clone", 31.184), 0x73: ("MPU-9255", 31.184), 0x74: ("MPU-6515", 31.184), 0x75: ("0x75 clone", 31.184),
    0x98: ("ICM-20689", 35.404),
}  # fmt: skip
UNKNOWN = replace(fakes.MPU6500, name="unknown", who_am_i=0x5A, fifo_bytes=(512,))
RATE_DPS, FORCE_G = (0.71, -0.37, 0.113), (-0.17, 0.53, 0.87)


class Constant:
    """The same three rates and three forces for ever."""

    def __init__(self, rate_dps, force_g):
        self.rate, self.force = np.array(rate_dps) * DEG, np.array(force_g) * G

    def rate_rad_s(self, t_s):
        return np.broadcast_to(self.rate, (len(t_s), 3))

    def specific_force_m_s2(self, t_s):
        return np.broadcast_to(self.force, (len(t_s), 3))


class Tone:
    """A sine of 1 g in accelerometer x."""

    def __init__(self, hz):
        self.hz = hz

    def rate_rad_s(self, t_s):
        return np.zeros((len(t_s), 3))

    def specific_force_m_s2(self, t_s):
        return np.outer(np.sin(2 * np.pi * self.hz * t_s), [G, 0, 0])


@pytest.fixture(params=CHIPS)
def chip(request):
    return CHIPS[request.param]


@pytest.fixture(params=CLASS_6500)
def relative(request):
    return CLASS_6500[request.param]


def settled(rig):
    """Mean gyroscope in deg/s, accelerometer in g, temperature in degC, past the filters' memory."""
    got = rig.got
    counts = got.counts[40:].astype(float).mean(0)
    return (
        counts[4:7] * got.scale.gyro_rad_s_per_lsb / DEG,
        counts[0:3] * got.scale.accel_m_s2_per_lsb / G,
        counts[3] * got.scale.temp_degc_per_lsb + got.scale.temp_degc_at_zero,
    )


def test_table_is_that_of_the_data_sheets_and_of_the_kernel():
    assert set(VARIANTS) == set(FACTS)
    for who_am_i, (name, degc) in FACTS.items():
        variant = VARIANTS[who_am_i]
        assert (variant.who_am_i, variant.name) == (who_am_i, name)
        assert 3400 * variant.temp_degc_per_lsb + variant.temp_degc_at_zero == pytest.approx(degc, abs=0.01)
        assert variant.source
        assert bool(variant.remark) == (who_am_i != 0x68)


def test_every_known_chip_has_a_fake_it_is_tried_on():
    assert set(VARIANTS) == {chip.who_am_i for chip in CHIPS.values()}


@pytest.mark.parametrize(("gyro_range", "accel_range"), [(250, 2), (500, 4), (1000, 8), (2000, 16)])
def test_three_values_come_out_on_their_axes_at_every_range(chip, gyro_range, accel_range):
    rate = tuple(gyro_range * x for x in RATE_DPS)
    force = tuple(accel_range * x for x in FORCE_G)
    parts = Imperfections(temp_degc=31.7, warm_temp_degc=31.7)
    rig = Rig(
        config(200, gyro=gyro_range, accel=accel_range),
        personality=chip,
        motion=Constant(rate, force),
        imperfections=parts,
    )
    rig.start().run(0.4)
    gyro, accel, temp = settled(rig)
    assert gyro == pytest.approx(rate, abs=0.51 * gyro_range / 32750)
    assert accel == pytest.approx(force, abs=0.51 * accel_range / 32768 / chip.accel_gain)
    assert temp == pytest.approx(31.7, abs=0.51 / 326.8)
    assert rig.health.fifo_resets == rig.health.chip_restarts == rig.health.config_mismatches == 0


def test_first_sample_is_of_the_configured_scale_whatever_ran_before(chip):
    """Another program left the widest filter, the FIFO stopping, and the gyroscopes in standby."""
    rig = Rig(personality=chip, motion=Constant((100, -200, 30), (0.5, -0.25, 0.75)), imperfections=PERFECT)
    for register, byte in ((0x6B, 0x11), (0x1A, 0x47), (0x1B, 0x1B), (0x1D, 0xCF), (0x6C, 0x3F)):
        rig.wr(register, byte)
    rig.start().run(0.4)
    gyro, accel, _ = settled(rig)
    assert gyro == pytest.approx((100, -200, 30), abs=0.05)
    assert accel == pytest.approx((0.5, -0.25, 0.75), abs=4e-4)


# Half power at the bandwidth of register 26, and for the 6500 class of RM9250 register 29.
@pytest.mark.parametrize(("dlpf", "old_hz", "new_hz"), [(1, 184, 218.1), (3, 44, 44.8), (4, 21, 21.2), (6, 5, 5.05)])
def test_accelerometer_is_filtered_as_asked(chip, dlpf, old_hz, new_hz):
    """In the 6500 class CONFIG filters the gyroscope only: without ACCEL_CONFIG_2 it is 218 Hz at every setting."""
    hz = new_hz if chip.class_6500 else old_hz
    gains = []
    for tone_hz in (0.9 * hz, 1.1 * hz):
        rig = Rig(config(1000, dlpf=dlpf), personality=chip, motion=Tone(tone_hz), imperfections=PERFECT).start()
        rig.run(2.0)
        x = rig.got.counts[300:, 0].astype(float) * rig.got.scale.accel_m_s2_per_lsb / G
        gains.append(np.sqrt(2) * x.std())
    assert gains[0] > 0.5**0.5 > gains[1]


def test_noise_of_the_accelerometer_falls_with_the_filter(relative):
    def sd(dlpf):
        rig = Rig(config(1000, dlpf=dlpf), personality=relative, motion=Constant((0, 0, 0), (0, 0, 1)),
                  imperfections=NOISE_ONLY).start()  # fmt: skip
        rig.run(1.0)
        return rig.got.counts[300:, 0].std()

    wide, narrow = sd(1), sd(6)
    # White noise through 218 and 5 Hz; slow samples of the narrow one scatter.
    assert wide / narrow == pytest.approx((218.1 / 5.05) ** 0.5, rel=0.4)


def test_fifo_holds_what_the_driver_takes_it_to_hold(chip):
    """Believed larger than it is, torn frames would be read; believed smaller, nothing would be but resets."""
    size = FIFO.get(chip.name, 1024)
    rig = Rig(config(1000), personality=chip, pll_error=0.0).start()
    assert rig.source.info.variant.fifo_bytes == rig.chip.fifo.size == size
    frames = size // FRAME_BYTES

    def after(ms):
        for _ in range(8):
            rig.drain(1)
        return rig.drain(ms)

    # Whole frames as long as there are three frames of room.
    assert len(after(frames - 8)) == pytest.approx(frames - 8, abs=3)
    assert rig.health.fifo_resets == 0
    after(frames - 3)
    assert (rig.health.fifo_near_full, rig.health.fifo_overflows) == (1, 0)
    after(frames + 5)
    assert (rig.health.fifo_near_full, rig.health.fifo_overflows) == (1, 1)
    rig.run(0.2)
    gap = rig.got.flags & Flag.GAP != 0
    assert gap.sum() == 2
    steps = np.diff(rig.numbers)
    assert (steps[~gap[1:]] == 1).all()


def test_chip_whose_supply_dips_comes_back_with_its_own_reset_value(chip):
    rig = Rig(personality=chip).start()
    rig.run(0.5)
    rig.chip.power_cut()
    rig.run(1.5)
    assert rig.health.chip_restarts == 1
    assert len(rig.got) > 250
    held = rig.chip.registers
    assert (held[0x1A], held[0x1B], held[0x1C], held[0x19]) == (3, 0x08, 0x08, 4)
    if chip.class_6500:
        assert held[0x1D] & 0x0F == 3
    numbers, gap = rig.numbers, rig.got.flags & Flag.GAP != 0
    assert gap.sum() == 1
    assert (np.diff(numbers)[~gap[1:]] == 1).all()


def test_filter_register_upset_while_streaming_is_written_anew(relative):
    rig = Rig(personality=relative).start()
    rig.run(0.5)
    rig.wr(0x1D, 0x08)
    rig.run(1.0)
    assert rig.chip.registers[0x1D] & 0x0F == 3
    assert rig.health.registers_upset == 1


@pytest.mark.parametrize(("register", "bits"), [(0x1A, 0x40), (0x1B, 0x01), (0x1B, 0x02), (0x6B, 0x10)])
def test_bit_that_only_the_6500_class_has_is_noticed_when_it_is_upset(register, bits):
    """FIFO_MODE, FCHOICE_B round the filter, gyroscopes in standby: in an MPU-6050 these bits are reserved."""
    rig = Rig(personality=fakes.MPU6500).start()
    rig.run(0.5)
    held = rig.chip.registers[register]
    rig.wr(register, held | bits)
    rig.run(1.0)
    assert rig.chip.registers[register] == held
    assert rig.health.registers_upset >= 1


def test_dlpf_0_is_refused_where_the_divider_would_not_divide(relative):
    """8000 samples a second come then, whatever SMPLRT_DIV says (RM9250 register 25)."""
    rig = Rig(config(1000, dlpf=0), personality=relative)
    with pytest.raises(SettingsError, match=r"dlpf = 0.*take dlpf = 1"):
        rig.start()
    assert rig.chip.written == []


def test_fifo_size_that_does_not_take_is_told_not_trusted():
    rig = Rig(chip_type=StubbornChip, personality=fakes.MPU6500)
    rig.chip.stubborn = lambda at, byte: byte & 0x3F if at == 0x1D else byte
    with pytest.raises(ChipUnstable, match="ACCEL_CONFIG_2 did not read back"):
        rig.start()


def test_other_chip_than_the_named_one_is_told_of_once(chip, caplog):
    rig = Rig(personality=chip)
    with caplog.at_level(logging.WARNING):
        rig.start().run(0.3)
        rig.chip.power_cut()
        rig.run(1.0)
    told = [record.message for record in caplog.records if "WHO_AM_I 0x" in record.message]
    assert len(told) == (chip.who_am_i != 0x68)
    assert all(f"0x{chip.who_am_i:02x}" in text for text in told)
    assert len(rig.source.info.remarks) == (chip.who_am_i != 0x68) + (chip.accel_gain != 1)


def test_one_bit_disturbed_on_its_way_does_not_make_another_chip_of_it(caplog):
    rig = Rig()
    asked = 0

    def alter(_k, transfer, answer):
        nonlocal asked
        asked += transfer.register == 0x75
        return b"\x69" if transfer.register == 0x75 and asked == 1 else answer

    rig.bus.alter = alter
    with caplog.at_level(logging.WARNING):
        rig.start()
    assert rig.source.info.variant is VARIANTS[0x68]
    assert caplog.text == ""


# Half-scale silicon: revision 1 in the trim's lowest bits, or revision 0 and product 4 (Betaflight, ArduPilot).
@pytest.mark.parametrize(
    ("trim", "product", "half"),
    [
        ((1, 0, 0), 0, True), ((-2099, 800, 1200), 0, True), ((0, 0, 0), 4, True), ((0, 0, 0), 0xF4, True),
        ((0, 0, 0), 0, False), ((0, 0, 0), 5, False), ((0, 1, 0), 4, False), ((1, 1, 0), 4, False),
        ((0, 0, 1), 4, False), ((1, 1, 1), 4, False), ((-2100, 801, 1200), 0, False),
    ],
)  # fmt: skip
def test_early_silicon_is_told_by_its_revision(trim, product, half):
    early = replace(fakes.MPU6050, product_id=product, accel_gain=0.5 if half else 1.0)
    rig = Rig(personality=early, accel_trim=trim, motion=Constant((1, 2, 3), FORCE_G), imperfections=PERFECT)
    rig.start().run(0.4)
    assert rig.source.info.accel_half_scale == half
    assert settled(rig)[1] == pytest.approx(FORCE_G, abs=2 / 4096)


def test_one_bit_disturbed_on_its_way_does_not_double_the_scale():
    rig = Rig(motion=Constant((1, 2, 3), FORCE_G), imperfections=PERFECT)
    times = 0

    def alter(_k, transfer, answer):
        nonlocal times
        if transfer.register == 0x06:
            times += 1
            return bytes([answer[0], 0x01, answer[2], 0x00, *answer[4:]]) if times == 1 else answer
        return answer

    rig.bus.alter = alter
    rig.start().run(0.4)
    assert not rig.source.info.accel_half_scale
    assert times == 3
    assert settled(rig)[1] == pytest.approx(FORCE_G, abs=2 / 8192)


def test_offset_words_of_the_6500_class_say_nothing_of_the_scale():
    rig = Rig(personality=fakes.MPU6500)
    rig.wr(0x6B, 0x01)
    rig.wr(0x07, 0x01)
    assert not rig.start().source.info.accel_half_scale


def accepted(personality, accept_id, **kwargs):
    rig = Rig(personality=personality, **kwargs)
    rig.source = ChipSource(
        rig.bus, address=ADDRESS, config=rig.config, clock=rig.clock, health=rig.health, accept_id=accept_id
    )
    return rig


def test_unknown_chip_is_driven_when_it_is_asked_for_and_says_so(caplog):
    rig = accepted(UNKNOWN, 0x5A, motion=Constant((10, 20, 30), FORCE_G), imperfections=NOISE_ONLY)
    with caplog.at_level(logging.WARNING):
        rig.start().run(0.4)
    info = rig.source.info
    assert info.accepted and "accepted as MPU-6500" in info.variant.name and "0x5a" in info.variant.name
    assert "asked for" in info.remarks[0]
    assert "asked for" in caplog.text
    gyro, accel, _ = settled(rig)
    assert gyro == pytest.approx((10, 20, 30), abs=0.1)
    assert accel == pytest.approx(FORCE_G, abs=5e-3)
    rig.chip.power_cut()
    rig.run(1.0)
    assert rig.health.chip_restarts == 1 and len(rig.got) > 150


@pytest.mark.parametrize("accept_id", [0, 0x5B, 0x68])
def test_unknown_chip_is_refused_where_another_was_asked_for(accept_id):
    rig = accepted(UNKNOWN, accept_id)
    with pytest.raises(WrongChip, match=r"0x5a.*accept_id"):
        rig.start()
    assert rig.chip.written == []


def test_known_chip_keeps_its_own_table_where_its_id_is_accepted():
    rig = accepted(fakes.MPU6050, 0x68).start()
    assert not rig.source.info.accepted
    assert rig.source.info.variant is VARIANTS[0x68]


@given(st.integers(0, 255), st.integers(0, 0xFE))
def test_identify_gives_a_chip_of_that_id_or_refuses_it(who_am_i, accept_id):
    known = who_am_i in VARIANTS or (who_am_i == accept_id and who_am_i != 0)
    try:
        assert identify(who_am_i, bus="x", address=0x68, accept_id=accept_id).who_am_i == who_am_i
    except WrongChip as error:
        assert error.found == who_am_i
        assert not known
    else:
        assert known


@pytest.mark.parametrize("accept_id", [-1, 0xFF, 0x100])
def test_id_that_a_floating_line_gives_cannot_be_accepted(accept_id):
    with pytest.raises(ValueError, match="accept_id"):
        identify(0x68, bus="x", address=0x68, accept_id=accept_id)
    with pytest.raises(SettingsError, match="accept_id"):
        parse_settings({"bus": {"accept_id": accept_id}}, where="x")
    assert parse_settings({"bus": {"accept_id": 0x5A}}, where="x").bus.accept_id == 0x5A


@pytest.mark.parametrize("name", ["accepted", "early", "ICM-20689"])
def test_recording_gives_the_same_samples_in_the_same_scale(name, tmp_path):
    personality = {"accepted": UNKNOWN, "early": fakes.MPU6050_EARLY, "ICM-20689": fakes.ICM20689}[name]
    rig = Rig(personality=personality, motion=Constant((10, 20, 30), FORCE_G), imperfections=NOISE_ONLY)
    path = tmp_path / "a.qrec"
    with RecordingWriter(path, settings=Settings(), clock=rig.clock) as writer:
        rig.source = ChipSource(
            rig.bus, address=ADDRESS, config=rig.config, clock=rig.clock, health=rig.health, accept_id=0x5A,
            on_stream=writer.begin, on_drain=writer.write,
        )  # fmt: skip
        rig.start().run(0.5)
    replay = ReplaySource(RecordingReader(path), health=Health())
    blocks = []
    while (block := replay.read()) is not None:
        blocks.append(block)
    assert replay.info == rig.source.info
    assert np.array_equal(np.concatenate([b.counts for b in blocks]), rig.got.counts)
    assert {b.scale for b in blocks} == {rig.got.scale}


def test_header_of_an_older_recording_is_that_of_a_chip_of_full_scale():
    info = StreamInfo(
        src="x", address=0x68, who_am_i=0x68, config=3, gyro_config=8, accel_config=8, smplrt_div=4
    )  # fmt: skip
    assert not info.accepted and not info.accel_half_scale
    assert info.scale.accel_m_s2_per_lsb == pytest.approx(G / 8192)
