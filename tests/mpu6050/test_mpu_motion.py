"""The motion interrupt: told when the board is moved and only then, with or without a wire, and never silent by
mistake."""

from __future__ import annotations

import pytest
from idle_rig import IdleRig, Pushed

from quavelet.core.errors import BusError, ChipUnstable
from quavelet.mpu6050.low_power import cycling
from quavelet.mpu6050.motion import watching_motion

AT_S = 3.0
WAKE_HZ = {"MPU-6050": 40.0, "MPU-6500": 31.25}


def pushed(by_g, name="MPU-6050", **kwargs):
    """Lying still, then at AT_S its z jumps by so much."""
    return IdleRig(name, motion=Pushed(by_g, ((AT_S, 1e9),)), **kwargs)


def watching(rig, threshold_mg=100.0, **kwargs):
    return watching_motion(rig.status(), variant=rig.variant, clock=rig.clock, threshold_mg=threshold_mg, **kwargs)


@pytest.mark.parametrize("name", ["MPU-6050", "MPU-6500", "ICM-20689", "clone-0x69"])
@pytest.mark.parametrize("wired", [False, True])
def test_push_is_told_with_its_time(name, wired):
    rig = pushed(0.6, name)
    with watching(rig) as motion:
        t_ns = motion.wait(10.0, line=rig.line if wired else None)
    assert t_ns is not None
    late_ms = t_ns / 1e6 - 1e3 * AT_S
    assert 0 <= late_ms <= (5 if wired else 15)


@pytest.mark.parametrize("wired", [False, True])
def test_board_that_lies_still_is_waited_for_as_long_as_asked(wired):
    rig = IdleRig()
    with watching(rig) as motion:
        begin_s = rig.now_s
        assert motion.wait(4.3, line=rig.line if wired else None) is None
        assert rig.now_s - begin_s == pytest.approx(4.3, abs=0.03)
        assert motion.wait(0.0) is None


@pytest.mark.parametrize(("push_g", "told"), [(0.08, False), (0.14, True), (-0.14, True)])
def test_threshold_is_in_mg(push_g, told):
    rig = pushed(push_g)
    with watching(rig, 100.0) as motion:
        assert (motion.wait(5.0) is not None) == told


@pytest.mark.parametrize(("name", "counts"), [("MPU-6050", 50), ("MPU-6500", 25)])
def test_scale_is_that_of_the_variant_or_the_one_measured(name, counts):
    rig = IdleRig(name)
    with watching(rig, 100.0):
        assert rig.chip.registers[0x1F] == counts
    with watching(rig, 100.0, mg_per_lsb=32.0):
        assert rig.chip.registers[0x1F] == 3


def test_part_that_counts_32_mg_is_had_by_its_scale():
    """As PS 6.2 says, where the register map says 2."""
    told = {}
    for push_g in (0.2, 0.6):
        rig = pushed(push_g, motion_threshold_mg_lsb=32.0)
        with watching(rig, 400.0, mg_per_lsb=32.0) as motion:
            told[push_g] = motion.wait(5.0) is not None
    assert told == {0.2: False, 0.6: True}


def test_push_shorter_than_the_duration_is_not_motion():
    for lasts_s, told in ((0.02, False), (0.2, True)):
        rig = IdleRig(motion=Pushed(0.5, ((AT_S, AT_S + lasts_s),)))
        with watching(rig, 100.0, duration_ms=60, high_pass_hz=0.63) as motion:
            assert (motion.wait(5.0) is not None) == told


def test_motion_while_nobody_waited_is_told_at_the_next_question_once():
    rig = IdleRig(motion=Pushed(0.5, ((AT_S, AT_S + 0.1),)))
    with watching(rig) as motion:
        rig.clock.sleep_until_ns(round(4e9))
        assert motion.wait(0.0) is not None
        assert motion.wait(1.0) is None


def test_push_while_the_chip_was_being_set_is_not_told():
    rig = IdleRig(motion=Pushed(0.5, ((0.2, 0.3),)))
    with watching(rig) as motion:
        assert rig.now_s > 0.5
        assert motion.wait(1.0) is None


def test_wire_that_came_off_costs_a_second_and_not_the_motion():
    rig = pushed(0.5)
    rig.chip.int_connected = False
    with watching(rig) as motion:
        t_ns = motion.wait(20.0, line=rig.line)
    assert t_ns is not None
    assert AT_S <= t_ns / 1e9 <= AT_S + 1.1


@pytest.mark.parametrize(
    "fault", ["brown-out", "asleep", "changed register=0x1f value=255", "changed register=0x38 bit=6"]
)
@pytest.mark.parametrize("wired", [False, True])
def test_chip_that_lost_its_setting_is_told_and_not_waited_for_in_silence(fault, wired):
    rig = IdleRig()
    with pytest.raises(ChipUnstable, match="did not read back"), watching(rig) as motion:
        rig.fault(fault)
        motion.wait(60.0, line=rig.line if wired else None)
    assert rig.now_s < 3.0


def test_chip_that_is_gone_is_a_bus_error():
    rig = IdleRig()
    with pytest.raises(BusError), watching(rig) as motion:
        rig.fault("unplugged")
        motion.wait(60.0)


@pytest.mark.parametrize("name", WAKE_HZ)
def test_chip_that_cycles_tells_of_motion_and_gives_its_samples_too(name):
    """Both ask INT_STATUS, which is cleared by whoever reads it first."""
    rig = pushed(0.6, name)
    status, before = rig.status(), rig.kept
    with (
        watching_motion(status, variant=rig.variant, clock=rig.clock, threshold_mg=100.0) as motion,
        cycling(status, variant=rig.variant, clock=rig.clock, wake_hz=WAKE_HZ[name]) as accel,
    ):
        while rig.now_s < AT_S + 1.0:
            z = accel.read().accel_m_s2[2]
        assert z == pytest.approx(1.6 * 9.80665, abs=0.1)
        assert motion.wait(0.0) is not None
        t_ns = motion.wait(0.5, line=rig.line)
        assert t_ns is None
    assert rig.kept == before


@pytest.mark.parametrize("name", ["MPU-6050", "MPU-6500"])
@pytest.mark.parametrize("awake", [False, True])
def test_chip_is_given_back_as_it_was_found(name, awake):
    rig = IdleRig(name)
    if awake:
        for register, value in ((0x6B, 0x01), (0x1C, 0x08), (0x37, 0xA0), (0x38, 0x01), (0x20, 7)):
            rig.wr(register, value)
    before = rig.kept
    with watching(rig, 200.0) as motion:
        assert rig.kept != before
        motion.wait(0.1)
    assert rig.kept == before


@pytest.mark.parametrize(
    ("name", "asked", "says"),
    [
        ("MPU-6050", {"threshold_mg": 0.5}, "give 2 to 510"),
        ("MPU-6050", {"threshold_mg": 600.0}, "give 2 to 510"),
        ("MPU-6050", {"threshold_mg": float("nan")}, "cannot be set"),
        ("MPU-6050", {"mg_per_lsb": 0.0}, "above 0"),
        ("MPU-6050", {"duration_ms": 0}, "1 to 255"),
        ("MPU-6050", {"duration_ms": 256}, "1 to 255"),
        ("MPU-6500", {"duration_ms": 2}, "give 1"),
        ("MPU-6050", {"high_pass_hz": 1.0}, "0.63"),
    ],
)
def test_what_the_chip_cannot_do_is_refused_before_anything_is_written(name, asked, says):
    rig = IdleRig(name)
    with pytest.raises(ValueError, match=says), watching(rig, **asked):
        pass
    assert rig.chip.written == []


def test_time_below_0_is_refused():
    rig = IdleRig()
    with watching(rig) as motion, pytest.raises(ValueError, match="0 or more"):
        motion.wait(-1.0)
