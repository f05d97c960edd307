"""What may become of board, chip and file between a kill and the next start: no wrong yaw is told as good."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from full_disk import files_up_to
from numpy.typing import NDArray
from service_bed import Bed, EventClock
from waiting import eventually

from hw_fakes import TYPICAL, FakeMpu6050, Motion, Still, board
from hw_fakes.magnetometers.base import MagnetometerImperfections
from hw_fakes.world.imperfections import Imperfections
from hw_fakes.world.motion_base import EulerMotion
from quavelet.attitude.heading import HeadingParams
from quavelet.core.units import RAD_PER_DEG
from quavelet.mpu6050.magnetometer.asked import MagnetometerParams
from quavelet.service.saved_state import read_state
from quavelet.settings import BusSettings, LoopSettings, Settings
from quavelet.sinks.message import Message

BOOT = "c0ffee" + 26 * "0"
PLAIN = Settings(bus=BusSettings(name="fake:bed"), loop=LoopSettings(rate_hz=50.0))
PLAIN = msgspec.structs.replace(PLAIN, chip=msgspec.structs.replace(PLAIN.chip, sample_rate_hz=100.0))
STILL_S = 14.0
"""The first life: long enough for a board that lies still to be kept."""
DEAD_S = 4.0


@dataclass(frozen=True, slots=True)
class Turns(EulerMotion):
    """Lies still, but from `from_s` to `until_s` turns by `rate_dps` about an axis that leans `lean_deg`."""

    from_s: float = 1e9
    until_s: float = 1e9
    rate_dps: float = 45.0
    before_deg: float = 0.0

    def euler_rad(self, t_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        angles, rates = np.zeros((len(t_s), 3)), np.zeros((len(t_s), 3))
        angles[:, 0] = RAD_PER_DEG * 10.0
        turned = self.rate_dps * (np.clip(t_s, self.from_s, self.until_s) - self.from_s)
        angles[:, 2] = RAD_PER_DEG * (self.before_deg + turned)
        rates[:, 2] = np.where((t_s > self.from_s) & (t_s < self.until_s), RAD_PER_DEG * self.rate_dps, 0.0)
        return angles, rates


LIES = Turns()


class World:
    """One folder, one start of the machine; services that are killed there one after the other."""

    def __init__(self, folder: Path, settings: Settings = PLAIN) -> None:
        self.file = folder / "imu.state"
        self.settings = settings
        self.now_s = 0.0
        self._environ = {"RUNTIME_DIRECTORY": str(folder), "QUAVELET_BOOT_ID": BOOT}

    def live(
        self,
        motion: Motion = LIES,
        *,
        for_s: float,
        prepare: Callable[[Bed], None] = lambda _: None,
    ) -> Bed:
        """A service from now on, killed `for_s` later: what it would still write then is not there."""
        left: list[bytes] = []
        bed = Bed(motion, settings=self.settings, clock=EventClock(self.now_s), environ=self._environ)
        prepare(bed)
        killed_s = self.now_s + for_s
        killed = list[float]()

        def kill() -> None:
            assert eventually(lambda: is_level(bed), look_s=0.002)
            left.extend([self.file.read_bytes()] if self.file.exists() else [])
            killed.append(bed.clock.now_ns() / 1e9)

        bed.clock.at(killed_s, kill)
        bed.run(until_s=killed_s + 0.05)
        assert killed
        self.file.unlink(missing_ok=True)
        for data in left:
            self.file.write_bytes(data)
        self.now_s = killed_s + DEAD_S
        return bed

    @property
    def kept_still(self) -> bool:
        """Whether the next start finds the attitude of a board at rest."""
        return self.file.exists() and read_state(self.file).still


def is_level(bed: Bed) -> bool:
    """Whether the file's thread, which runs in real time, has written what it was given."""
    continuity = bed.service.continuity
    assert continuity is not None
    (stats,) = continuity.stats()
    return stats.delivered == continuity.handed_over


def went_on(bed: Bed) -> bool:
    return any("goes on from where it was" in line for line in bed.said)


def trusted(bed: Bed) -> list[Message]:
    return [message for message in bed.messages if not message.flags]


def assert_afresh(bed: Bed, reason: str = "") -> None:
    assert not went_on(bed), bed.said
    assert any("begins afresh" in line and reason in line for line in bed.said) or not reason, bed.said
    assert "settling" in bed.messages[0].flags
    assert all(abs(message.yaw_deg) < 1.0 for message in trusted(bed))


def assert_yaw(bed: Bed, yaw_deg: float) -> None:
    """What is not flagged is right within three sigma, and there is some."""
    assert went_on(bed), bed.said
    assert trusted(bed)
    for message in trusted(bed):
        assert abs(message.yaw_deg - yaw_deg) < 3.0 * message.sigma_deg[2] + 0.05


def of(imperfections: Imperfections, motion: Motion = LIES) -> Callable[[Bed], None]:
    """A chip with these errors in the place of the bed's, of the same trim."""

    def exchange(bed: Bed) -> None:
        bed.chip = FakeMpu6050(
            bed.clock, motion=motion, seed=2, accel_trim=bed.chip.accel_trim, imperfections=imperfections
        )

    return exchange


def test_killed_while_still_yaw_is_right(tmp_path: Path) -> None:
    world = World(tmp_path)
    before = world.live(Turns(from_s=5.0, until_s=7.0, rate_dps=20.0), for_s=STILL_S + 4.0)
    assert_yaw(world.live(for_s=6.0), before.messages[-1].yaw_deg)


@pytest.mark.parametrize("rate_dps", [2.0, 45.0, 400.0])
def test_killed_half_a_second_after_it_began_to_turn_yaw_is_not_gone_on_from(rate_dps: float, tmp_path: Path) -> None:
    world = World(tmp_path)
    world.live(Turns(from_s=STILL_S - 0.5, rate_dps=rate_dps), for_s=STILL_S)
    assert not world.kept_still
    assert_afresh(world.live(for_s=3.0))


def test_killed_again_after_it_was_turned_before_the_next_copy_was_due(tmp_path: Path) -> None:
    """Its file is of the life before, and knows nothing of the turn."""
    world = World(tmp_path)
    world.live(for_s=STILL_S)
    assert went_on(world.live(Turns(from_s=2.0, until_s=4.0), for_s=4.5))
    assert not world.kept_still
    assert_afresh(world.live(for_s=3.0))


def test_killed_again_after_it_lay_still_yaw_is_still_right(tmp_path: Path) -> None:
    world = World(tmp_path)
    before = world.live(Turns(from_s=5.0, until_s=7.0, rate_dps=20.0), for_s=STILL_S + 4.0)
    for _ in range(2):
        assert_yaw(world.live(for_s=6.0), before.messages[-1].yaw_deg)


def test_killed_again_before_the_board_was_seen_to_be_still_yaw_is_not_gone_on_from(tmp_path: Path) -> None:
    world = World(tmp_path)
    world.live(for_s=STILL_S)
    assert went_on(world.live(for_s=1.2))
    assert_afresh(world.live(for_s=3.0), "moving, or its attitude not yet to be trusted")


def test_killed_again_after_the_file_was_refused_it_is_not_taken_by_the_third(tmp_path: Path) -> None:
    """The second saw the board in somebody's hand; to the third it lies as it lay to the first, and is turned."""
    world = World(tmp_path)
    world.live(for_s=STILL_S)
    assert_afresh(world.live(Still(roll_deg=40.0), for_s=2.0), "does not lie as it lay")
    assert not world.kept_still
    assert_afresh(world.live(for_s=3.0))


def test_killed_after_a_turn_that_no_disk_had_room_for(tmp_path: Path) -> None:
    """The file would say what was before the turn."""
    world = World(tmp_path)
    full = files_up_to(1000)

    def fill(bed: Bed) -> None:
        bed.clock.at(STILL_S - 4.0, full.__enter__)

    try:
        world.live(Turns(from_s=STILL_S - 3.0, until_s=STILL_S - 1.0), for_s=STILL_S, prepare=fill)
    finally:
        full.__exit__(None, None, None)
    assert not world.kept_still
    assert_afresh(world.live(for_s=3.0))


def test_killed_while_the_chip_was_unplugged(tmp_path: Path) -> None:
    """It comes back turned, and lies as it lay."""
    world = World(tmp_path)
    world.live(for_s=STILL_S + 2.0, prepare=lambda bed: bed.clock.at(STILL_S, lambda: bed.fault("unplugged")))
    assert not world.kept_still
    assert_afresh(world.live(for_s=3.0))


def test_an_exchanged_chip_of_the_same_trim_is_known_by_its_errors(tmp_path: Path) -> None:
    world = World(tmp_path)
    world.live(for_s=STILL_S)
    x, y, z = TYPICAL.gyro_bias_rad_s
    other = replace(TYPICAL, gyro_bias_rad_s=(x, y, z + 0.4 * RAD_PER_DEG))
    assert_afresh(world.live(for_s=3.0, prepare=of(other)), "does not lie as it lay")


@pytest.mark.parametrize("warmer_degc", [-30.0, -8.0, -2.0, 2.0, 8.0, 30.0])
def test_a_chip_that_has_become_warmer_or_colder_is_right_or_begins_afresh(warmer_degc: float, tmp_path: Path) -> None:
    world = World(tmp_path)
    x, y, z = 0.03 * RAD_PER_DEG, -0.02 * RAD_PER_DEG, 0.03 * RAD_PER_DEG
    part = replace(TYPICAL, gyro_bias_rad_s_degc=(x, y, z), warm_temp_degc=TYPICAL.temp_degc)
    before = world.live(Turns(from_s=5.0, until_s=7.0, rate_dps=20.0), for_s=STILL_S + 4.0, prepare=of(part))
    now_degc = part.temp_degc + warmer_degc
    after = world.live(for_s=8.0, prepare=of(replace(part, temp_degc=now_degc, warm_temp_degc=now_degc)))
    if went_on(after):
        assert abs(warmer_degc) < 5.0
        assert_yaw(after, before.messages[-1].yaw_deg)
    else:
        assert abs(warmer_degc) > 5.0
        assert_afresh(after, "does not lie as it lay")


@pytest.mark.parametrize("leans_deg", [0.3, 3.0])
def test_turned_while_dead_on_a_table_that_is_not_quite_level_shows(leans_deg: float, tmp_path: Path) -> None:
    """A table that leans by this: turned by 60 degrees on it, the board leans elsewhere."""
    world = World(tmp_path)
    world.live(Still(roll_deg=leans_deg), for_s=STILL_S)
    turned = RAD_PER_DEG * 60.0
    there = Still(roll_deg=leans_deg * np.cos(turned), pitch_deg=-leans_deg * np.sin(turned), yaw_deg=60.0)
    assert_afresh(world.live(there, for_s=3.0), "does not lie as it lay")


def test_turned_while_dead_about_the_vertical_itself_is_not_seen_and_that_is_told(tmp_path: Path) -> None:
    """Six axes cannot see it: the gap and the journal are all there is."""
    world = World(tmp_path)
    world.live(for_s=STILL_S)
    after = world.live(Turns(before_deg=60.0), for_s=4.0)
    assert any("turned about the vertical since, nothing would show it" in line for line in after.said)
    first = after.messages[0]
    assert "gap" in first.flags and "settling" in first.flags
    assert first.gap_ns >= DEAD_S * 1e9


def with_magnetometer(turned_deg: float) -> Callable[[Bed], None]:
    def fit(bed: Bed) -> None:
        there, motion = board("gy-87"), Turns(before_deg=turned_deg)
        aux = there.aux_master(bed.clock, motion, imperfections=MagnetometerImperfections(noise_ut=0.5))
        bed.chip = FakeMpu6050(bed.clock, motion=motion, seed=1, personality=there.personality, aux=aux)
        bed.beside = dict(aux.outside())

    return fit


@pytest.mark.parametrize("turned_deg", [0.0, 60.0])
def test_turned_while_dead_a_magnetometer_shows_it(turned_deg: float, tmp_path: Path) -> None:
    settings = msgspec.structs.replace(
        PLAIN,
        magnetometer=MagnetometerParams(use="auto"),
        heading=HeadingParams(hard_iron_ut=(0.0, 0.0, 0.0), hard_iron_sigma_ut=0.2),
    )
    world = World(tmp_path, settings)
    before = world.live(for_s=STILL_S, prepare=with_magnetometer(0.0))
    assert before.messages[-1].yaw == "magnetic"
    after = world.live(for_s=8.0, prepare=with_magnetometer(turned_deg))
    assert went_on(after) is (turned_deg == 0.0), after.said
    yaw_deg = before.messages[-1].yaw_deg + turned_deg
    assert trusted(after)
    for message in trusted(after):
        if message.yaw == "magnetic":
            off_deg = (message.yaw_deg - yaw_deg + 180.0) % 360.0 - 180.0
            assert abs(off_deg) < 3.0 * message.sigma_deg[2] + 0.5
    assert trusted(after)[-1].yaw == "magnetic"
