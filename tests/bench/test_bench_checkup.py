"""Each way in which a board can be bad is told by its own finding, with the one thing to do; a good one passes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from boards import Checked, Clock3231, Registers, checked, chip, good_chip

from hw_fakes import (
    MPU6000,
    MPU6500,
    NOISE_ONLY,
    PERSONALITIES,
    TYPICAL,
    FakeBus,
    FakeDataReady,
    FakeMpu6050,
    Personality,
    Sway,
    Turntable,
)
from quavelet.bus.protocol import Edge
from quavelet.core.clock import Clock
from quavelet.core.errors import BusError, ChipUnstable, DeviceLost, DeviceMissing, WrongChip
from quavelet.mpu6050.config import ChipConfig
from quavelet.settings import BusSettings, Settings

POINTS = [
    *(
        "bus",
        "who answers",
        "WHO_AM_I",
        "wire speed",
        "registers",
        "magnetometer",
        "chip",
        "sample rate",
        "no sample lost",
    ),
    *("board still", "axes alive", "gyroscope noise", "accelerometer noise", "gyroscope bias", "gravity"),
    *("temperature", "self-test", "FIFO"),
]


def config(rate_hz: float = 200.0, *, dlpf: int = 3, gyro: int = 500, accel: int = 4) -> Settings:
    return Settings(chip=ChipConfig(gyro_range_dps=gyro, accel_range_g=accel, dlpf=dlpf, sample_rate_hz=rate_hz))


def wired(line: str = "fake:int") -> Settings:
    return Settings(bus=BusSettings(int_line=line))


def test_a_data_ready_line_that_works_passes_with_its_rate() -> None:
    done = checked(settings=wired())
    assert (done.bad, done.error) == ([], None)
    at = POINTS.index("sample rate") + 2
    assert done.names == [*POINTS[:at], "data-ready line", *POINTS[at:]]
    line, rate = done["data-ready line"], done["sample rate"]
    assert "fake:int, one with each sample" in line.found
    assert line.figures["pulses_hz"] == pytest.approx(rate.figures["rate_hz"], rel=1e-4)


def test_a_data_ready_line_without_pulses_is_told_where_to_wire_it() -> None:
    done = checked(settings=wired(), prepare=lambda bus: setattr(bus.targets[0x68], "int_connected", False))
    assert done.bad == ["data-ready line"]
    assert done["data-ready line"].found.startswith("no pulse from fake:int in 5 s")
    assert "wire the board's INT to fake:int" in done["data-ready line"].advice


def test_a_data_ready_line_of_which_half_the_pulses_come_is_bad() -> None:
    done = checked(settings=wired(), prepare=half_of_the_pulses)
    assert done.bad == ["data-ready line"]
    assert "pulses/s from fake:int where the chip takes 20" in done["data-ready line"].found


def half_of_the_pulses(bus: FakeBus) -> None:
    class Half(FakeDataReady):
        def wait(self, timeout_s: float) -> list[Edge]:
            return [Edge(edge.t_ns, edge.seq // 2) for edge in super().wait(timeout_s) if edge.seq % 2]

    bus.data_ready = lambda name, /, *, address: Half(  # type: ignore[method-assign]
        good_chip(bus.clock) if address != 0x68 else bus.targets[0x68], clock=bus.clock, name=name
    )


def test_a_data_ready_line_that_is_none_does_not_end_the_check_up() -> None:
    done = checked(settings=wired("pinctrl-rp1:17"))
    assert (done.bad, done.error) == (["data-ready line"], None)
    assert "write fake:int" in done["data-ready line"].advice
    assert set(POINTS) < set(done.names)


def well_formed(done: Checked) -> None:
    """No name twice, and advice for all that is bad."""
    assert len(set(done.names)) == len(done.names)
    assert [finding.name for finding in done.findings if not finding.ok and not finding.advice] == []


@pytest.mark.parametrize("make", [good_chip, chip(imperfections=TYPICAL), chip(personality=MPU6000)])
@pytest.mark.parametrize("dlpf", range(7))
@pytest.mark.parametrize(("gyro", "accel"), [(250, 2), (2000, 16)])
def test_a_good_board_passes_with_every_filter_and_range(
    make: Callable[[Clock], FakeMpu6050], dlpf: int, gyro: int, accel: int
) -> None:
    done = checked(make, settings=config(dlpf=dlpf, gyro=gyro, accel=accel))
    assert (done.bad, done.error) == ([], None)
    assert done.names[: len(POINTS)] == POINTS
    assert [finding.name for finding in done.findings if finding.advice] == []


@pytest.mark.parametrize("speed_hz", [10_000, 100_000, 400_000, 1_000_000])
def test_the_speed_is_that_of_the_wires(speed_hz: int) -> None:
    done = checked(speed_hz=speed_hz)
    assert done["wire speed"].figures["bus_hz"] == pytest.approx(speed_hz, rel=0.001)
    assert bool(done["wire speed"].advice) == (speed_hz != 400_000)


def test_wires_that_are_too_slow_for_the_rate_are_told_before_samples_are_lost() -> None:
    done = checked(speed_hz=100_000, settings=config(1000.0))
    assert done.bad[0] == "wire speed"
    assert "i2c_arm_baudrate=400000" in done["wire speed"].advice
    slower = float(done["wire speed"].advice.split("sample_rate_hz of ")[1].split()[0])
    rate_hz = 1000.0 / (1000.0 // slower + 1)
    assert checked(speed_hz=100_000, settings=config(rate_hz)).bad == []


def test_a_silent_bus_and_a_silent_board_are_told_apart() -> None:
    alone, among_others = checked(None), checked(None, beside={0x77: Registers()})
    for done in (alone, among_others):
        assert done.bad == ["who answers"]
        assert isinstance(done.error, DeviceMissing)
    assert "SDA and SCL not swapped" in alone["who answers"].advice
    assert "the wires are well" in among_others["who answers"].advice
    assert "0x77 (a barometer?)" in among_others["who answers"].found


@pytest.mark.parametrize(("asked", "there"), [(0x68, 0x69), (0x69, 0x68)])
def test_a_board_at_the_other_address_is_found(asked: int, there: int) -> None:
    done = checked(at=there, settings=Settings(bus=BusSettings(address=asked)))
    assert done.bad == ["who answers"]
    assert f"give --address 0x{there:02x}" in done["who answers"].advice
    assert checked(at=there, settings=Settings(bus=BusSettings(address=there))).bad == []


def test_a_clock_chip_at_the_other_address_is_not_taken_for_the_board() -> None:
    done = checked(lambda _clock: Clock3231(), settings=Settings(bus=BusSettings(address=0x69)))
    assert done.bad == ["who answers"]
    assert "0x68" in done["who answers"].found
    assert "--address" not in done["who answers"].advice


def test_a_clock_chip_is_known_by_its_time_and_nothing_is_written_to_it() -> None:
    clock_chip = Clock3231()
    done = checked(lambda _clock: clock_chip)
    assert done.bad == ["WHO_AM_I"]
    assert "clock" in done["WHO_AM_I"].found
    assert "AD0" in done["WHO_AM_I"].advice
    assert clock_chip.written == []


@pytest.mark.parametrize("who_am_i", [0x00, 0x33, 0xA5, 0xFF])
def test_nothing_is_written_to_a_chip_that_is_not_ours(who_am_i: int) -> None:
    other = Registers(r75=who_am_i, r03=0xAA)
    done = checked(lambda _clock: other, beside={0x77: (neighbour := Registers())})
    assert done.bad == ["WHO_AM_I"]
    assert isinstance(done.error, WrongChip)
    assert f"0x{who_am_i:02x}" in done["WHO_AM_I"].found
    assert other.written == neighbour.written == []


def test_a_line_held_low_stops_the_check_up_at_once() -> None:
    done = checked(good_chip, "time-out p=1")
    assert done.names == ["bus", "who answers"]
    assert "held low" in done["who answers"].advice
    assert type(done.error) is BusError


def test_disturbed_wires_are_told_by_the_registers() -> None:
    for fault in ("nack p=0.02 seed=1", "flip-write p=0.05 seed=2", "eio p=0.05 seed=3"):
        done = checked(good_chip, fault)
        assert not done["registers"].ok, fault
        assert "the wires are disturbed" in done["registers"].advice
        well_formed(done)


def test_a_chip_that_takes_no_writes_is_not_blamed_on_the_wires() -> None:
    done = checked(lambda _clock: Registers(r75=0x68, r6B=0x40))
    assert "takes no writes" in done["registers"].found
    assert isinstance(done.error, ChipUnstable)
    well_formed(done)


@pytest.mark.parametrize("at_s", [0.05, 0.1, 0.2, 0.5, 2.0, 4.0])
def test_a_chip_unplugged_at_any_time_ends_the_check_up_with_one_finding(at_s: float) -> None:
    done = checked(good_chip, f"unplugged at={at_s}")
    assert isinstance(done.error, DeviceLost | ChipUnstable)
    assert done.names[-1] == "stopped"
    assert set(done.bad) <= {"no sample lost", "stopped"}
    assert "no answer from address 0x68" in done.findings[-1].advice


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("brown-out at=3", "the supply dips"),
        ("changed at=3 register=0x1b value=0", "the supply dips"),
        ("overflow at=3", "the host came too late"),
        ("slip at=3", "the wires are disturbed"),
        ("frozen at=3", "see 'axes alive'"),
    ],
)
def test_lost_samples_are_told_with_what_lost_them(fault: str, words: str) -> None:
    done = checked(good_chip, fault)
    assert not done["no sample lost"].ok
    assert words in done["no sample lost"].advice
    well_formed(done)


def test_disturbed_transfers_that_were_made_good_are_a_note() -> None:
    done = checked(good_chip, "eio every=0.3")
    assert done.bad == []
    assert "failed" in done["no sample lost"].found
    assert done["no sample lost"].advice


def test_another_chip_put_in_its_place_is_told() -> None:
    done = checked(good_chip, "swapped at=3")
    assert isinstance(done.error, DeviceLost)
    assert "exchanged" in done.findings[-1].advice


def test_a_frozen_chip_is_not_judged_by_its_words() -> None:
    done = checked(good_chip, "frozen")
    assert not done["axes alive"].ok
    assert "gravity" not in done.names
    well_formed(done)


def test_an_axis_that_is_dead_is_named() -> None:
    def make(clock: Clock) -> FakeMpu6050:
        broken = good_chip(clock)

        def spoil(words: Any) -> Any:
            spoilt = words.copy()
            spoilt[:, 5] = 17
            return spoilt

        broken.spoil_words = spoil
        return broken

    done = checked(make)
    assert done["axes alive"].found == "gyroscope y never changed"


def test_a_board_that_is_moved_is_told_and_not_judged() -> None:
    done = checked(chip(motion=Sway()))
    assert done.bad == ["board still"]
    assert "gravity" not in done.names


@pytest.mark.parametrize(("scale", "words"), [(0.5, "half of"), (2.0, "twice"), (1.3, "")])
def test_a_wrong_scale_is_seen_in_gravity(scale: float, words: str) -> None:
    done = checked(chip(imperfections=replace(NOISE_ONLY, accel_scale=(scale,) * 3)))
    assert done.bad == ["gravity"]
    assert words in done["gravity"].found
    assert done["gravity"].figures["gravity_g"] == pytest.approx(scale, rel=0.01)


@pytest.mark.parametrize(
    ("times", "ok", "advice"), [(1, True, False), (2, True, False), (5, True, True), (11, False, True)]
)
def test_noise_is_judged_against_the_data_sheet(times: float, ok: bool, advice: bool) -> None:
    noisy = replace(NOISE_ONLY, gyro_noise_rad_s_rthz=times * NOISE_ONLY.gyro_noise_rad_s_rthz)
    found = checked(chip(imperfections=noisy))["gyroscope noise"]
    assert (found.ok, bool(found.advice)) == (ok, advice)
    assert found.figures["z_dps_rthz"] == pytest.approx(0.005 * times, rel=0.15)


def test_a_bias_out_of_the_data_sheet_is_told() -> None:
    assert checked(chip(imperfections=replace(NOISE_ONLY, gyro_bias_rad_s=(0.5, 0.0, 0.0)))).bad == ["gyroscope bias"]
    turning = Turntable(start_s=0.0, turn_deg=36_000.0, ramp_s=0.1)
    assert checked(chip(motion=turning)).bad == ["gyroscope bias"]


@pytest.mark.parametrize(("error", "ok"), [(-0.01, True), (0.01, True), (0.04, False)])
def test_a_chip_off_its_pll_is_told_by_its_rate(error: float, ok: bool) -> None:
    done = checked(chip(pll_error=error))
    assert done["sample rate"].ok == ok
    assert done["sample rate"].figures["error_percent"] == pytest.approx(100 * error, abs=0.05)


def test_a_temperature_that_cannot_be_is_told() -> None:
    assert checked(good_chip, "temperature by=80").bad == ["temperature"]
    warm = checked(good_chip, "temperature by=25")
    assert (warm.bad, bool(warm["temperature"].advice)) == ([], True)


def test_a_fifo_of_another_size_is_told() -> None:
    clone = replace(MPU6000, fifo_bytes=(512,))
    done = checked(chip(personality=clone))
    assert not done["FIFO"].ok
    assert "holds 512 bytes where the MPU-6050 has 1024" in done["FIFO"].found


def test_a_good_chip_is_left_as_after_power_up() -> None:
    chips: list[FakeMpu6050] = []

    def make(clock: Clock) -> FakeMpu6050:
        chips.append(good_chip(clock))
        return chips[0]

    checked(make)
    assert chips[0].written[-1] == (0x6B, 0x80)


@pytest.mark.parametrize("personality", PERSONALITIES, ids=lambda personality: personality.name)
def test_every_chip_of_the_family_passes_and_its_owner_hears_which_it_is(personality: Personality) -> None:
    done = checked(chip(personality=personality))
    assert done.bad == []
    assert f"0x{personality.who_am_i:02x}" in done["WHO_AM_I"].found
    assert bool(done["chip"].advice) == (personality.name not in ("MPU-6050", "MPU-6000", "MPU-9150"))


def test_a_chip_that_is_unknown_passes_where_its_owner_asks_for_it() -> None:
    unknown = chip(personality=replace(MPU6500, who_am_i=0x7D))
    refused = checked(unknown)
    assert refused.bad == ["WHO_AM_I"]
    assert "accept_id" in refused["WHO_AM_I"].advice
    accepted = checked(unknown, settings=Settings(bus=BusSettings(accept_id=0x7D)))
    assert accepted["WHO_AM_I"].ok
    assert "gravity" in accepted.names
