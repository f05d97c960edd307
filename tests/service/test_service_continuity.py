"""The attitude over a restart: gone on with where all speaks for it, else afresh with the reason told."""

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from service_bed import Bed, EventClock
from waiting import eventually

from hw_fakes import Still
from hw_fakes.world.motion_base import EulerMotion
from quavelet.core.errors import DeviceLost
from quavelet.service.saved_state import read_state, write_state
from quavelet.settings import BusSettings, LoopSettings, OutputSettings, ServiceSettings, Settings, StartSettings
from quavelet.sinks.message import Message

PLAIN = Settings(bus=BusSettings(name="fake:bed"))
BOOT = "c0ffee" + 26 * "0"
KILLED_S, TURN_DEG = 26.0, 40.0


@dataclass(frozen=True, slots=True)
class TurnedOnce(EulerMotion):
    """Still, turned about the vertical from 5 to 7 s, and still again."""

    def euler_rad(self, t_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        rate = np.deg2rad(TURN_DEG) / 2.0
        angles, rates = np.zeros((len(t_s), 3)), np.zeros((len(t_s), 3))
        angles[:, 0] = np.deg2rad(10.0)
        angles[:, 2] = rate * np.clip(t_s - 5.0, 0.0, 2.0)
        rates[:, 2] = np.where((t_s > 5.0) & (t_s < 7.0), rate, 0.0)
        return angles, rates


@dataclass(frozen=True, slots=True)
class Killed:
    """What a killed service left: its file, and its last message before the copy."""

    file: Path
    last: Message


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Killed:
    folder = tmp_path_factory.mktemp("killed")
    bed = Bed(TurnedOnce(), settings=PLAIN, environ={"RUNTIME_DIRECTORY": str(folder), "QUAVELET_BOOT_ID": BOOT})
    bed.clock.at(KILLED_S - 0.1, lambda: shutil.copy(folder / "imu.state", folder / "as-killed"))
    bed.run(until_s=KILLED_S)
    assert abs(abs(bed.messages[-1].yaw_deg) - TURN_DEG) < 2.0
    return Killed(folder / "as-killed", bed.messages[-1])


def started_again(
    killed: Killed,
    folder: Path,
    *,
    at_s: float = KILLED_S + 5,
    until_s: float = 2.5,
    settings: Settings = PLAIN,
    motion: EulerMotion | None = None,
    boot: str = BOOT,
    accel_trim: tuple[int, int, int] = (100, -200, 300),
) -> Bed:
    """The next start, at `at_s`, with what is in the folder or else the killed one's file."""
    file = folder / "imu.state"
    if not file.exists() and not file.is_symlink():
        shutil.copy(killed.file, file)
    bed = Bed(
        motion or TurnedOnce(),
        settings=settings,
        clock=EventClock(at_s),
        accel_trim=accel_trim,
        environ={"RUNTIME_DIRECTORY": str(folder), "QUAVELET_BOOT_ID": boot},
    )
    bed.run(until_s=at_s + until_s)
    return bed


def assert_afresh(bed: Bed, reason: str) -> None:
    (told,) = [line for line in bed.said if "state file" in line]
    assert "begins afresh" in told and reason in told, told
    assert abs(bed.messages[-1].yaw_deg) < 1.0
    # Flagged from the first message on until it is settled again.
    assert "settling" in bed.messages[0].flags


def test_yaw_goes_on_from_where_it_was_with_a_larger_sigma(killed: Killed, tmp_path: Path) -> None:
    bed = started_again(killed, tmp_path)
    first, last = bed.messages[0], bed.messages[-1]
    assert any("goes on from where it was" in line for line in bed.said)
    assert abs(last.yaw_deg - killed.last.yaw_deg) < 0.5
    assert abs(last.roll_deg - killed.last.roll_deg) < 0.2
    assert first.sigma_deg[2] > killed.last.sigma_deg[2]
    assert "gap" in first.flags and 5e9 < first.gap_ns < 20e9
    assert "settling" in first.flags and last.flags == []
    assert "bias_unknown" not in first.flags


def test_the_longer_the_gap_the_larger_the_sigma(killed: Killed, tmp_path: Path) -> None:
    sigmas = []
    for n, gap_s in enumerate((1.0, 15.0)):
        (folder := tmp_path / str(n)).mkdir()
        sigmas.append(started_again(killed, folder, at_s=KILLED_S + gap_s, until_s=1.0).messages[0].sigma_deg[2])
    assert sigmas[0] < sigmas[1]


def test_a_restart_in_good_order_goes_on_too(tmp_path: Path) -> None:
    environ = {"RUNTIME_DIRECTORY": str(tmp_path), "QUAVELET_BOOT_ID": BOOT}
    before = Bed(TurnedOnce(), settings=PLAIN, environ=environ)
    before.run(until_s=20)
    after = Bed(TurnedOnce(), settings=PLAIN, environ=environ, clock=EventClock(22))
    after.run(until_s=24)
    assert abs(after.messages[-1].yaw_deg - before.messages[-1].yaw_deg) < 0.5


def test_nothing_is_kept_of_a_chip_that_was_lost(tmp_path: Path) -> None:
    bed = Bed(settings=PLAIN, environ={"RUNTIME_DIRECTORY": str(tmp_path), "QUAVELET_BOOT_ID": BOOT})
    bed.clock.at(7.5, lambda: bed.fault("unplugged"))
    with pytest.raises(DeviceLost):
        bed.service.run()
    assert list(tmp_path.iterdir()) == []


def test_an_old_state_is_refused(killed: Killed, tmp_path: Path) -> None:
    assert_afresh(started_again(killed, tmp_path, at_s=KILLED_S + 40), "s old, 30 s are the most")


def test_a_state_from_the_future_is_refused(killed: Killed, tmp_path: Path) -> None:
    assert_afresh(started_again(killed, tmp_path, at_s=3, motion=Still(roll_deg=10)), "from the future")


def test_a_state_of_another_start_of_the_machine_is_refused(killed: Killed, tmp_path: Path) -> None:
    assert_afresh(started_again(killed, tmp_path, boot="beef" + 28 * "0"), "machine has been started anew")


def test_a_state_of_another_chip_is_refused(killed: Killed, tmp_path: Path) -> None:
    assert_afresh(started_again(killed, tmp_path, accel_trim=(104, -200, 300)), "another chip")


def test_a_state_of_other_settings_is_refused(killed: Killed, tmp_path: Path) -> None:
    other = msgspec.structs.replace(PLAIN, start=StartSettings(still_s=1.0))
    assert_afresh(started_again(killed, tmp_path, settings=other), "settings, the calibration or the program")


def test_settings_that_the_attitude_does_not_depend_on_may_be_others(killed: Killed, tmp_path: Path) -> None:
    other = msgspec.structs.replace(PLAIN, loop=LoopSettings(rate_hz=50.0), output={"x": OutputSettings(to="stdout")})
    bed = started_again(killed, tmp_path, settings=other)
    assert any("goes on from where it was" in line for line in bed.said)


def test_a_board_that_has_been_tilted_since_begins_afresh(killed: Killed, tmp_path: Path) -> None:
    assert_afresh(started_again(killed, tmp_path, motion=Still(roll_deg=10.7)), "does not lie as it lay")


def test_a_board_that_moves_begins_afresh(killed: Killed, tmp_path: Path) -> None:
    bed = started_again(killed, tmp_path, at_s=KILLED_S + 5, motion=Wobbling())
    assert any("begins afresh" in line and ("board moves" in line or "does not lie" in line) for line in bed.said)


@dataclass(frozen=True, slots=True)
class Wobbling(EulerMotion):
    """In a hand."""

    def euler_rad(self, t_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        angles, rates = np.zeros((len(t_s), 3)), np.zeros((len(t_s), 3))
        angles[:, 0] = np.deg2rad(10.0) + 0.05 * np.sin(12.0 * t_s)
        rates[:, 0] = 0.6 * np.cos(12.0 * t_s)
        return angles, rates


def test_a_board_that_was_killed_while_it_moved_begins_afresh(tmp_path: Path) -> None:
    file = tmp_path / "imu.state"
    environ = {"RUNTIME_DIRECTORY": str(tmp_path), "QUAVELET_BOOT_ID": BOOT}
    bed = Bed(TurnsAt8(), settings=PLAIN, environ=environ)
    # At 7.5 s the file says that it is still; the turn begins at 8 s, and the kill comes long before the next copy.
    # The file is written by a thread in real time, the clock stands for it.
    seen: list[bool] = []
    bed.clock.at(7.5, lambda: seen.append(eventually(lambda: file.exists() and read_state(file).still)))
    bed.clock.at(9.8, lambda: seen.append(eventually(lambda: not read_state(file).still)))
    bed.run(until_s=10.0)
    assert seen == [True, True]


@dataclass(frozen=True, slots=True)
class TurnsAt8(EulerMotion):
    """Still for 8 s, then turning about the vertical."""

    def euler_rad(self, t_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        angles, rates = np.zeros((len(t_s), 3)), np.zeros((len(t_s), 3))
        angles[:, 2] = 0.5 * np.maximum(0.0, t_s - 8.0)
        rates[:, 2] = np.where(t_s > 8.0, 0.5, 0.0)
        return angles, rates


@pytest.mark.parametrize("kind", ["truncated", "empty", "huge", "foreign", "folder", "pipe", "link", "bit", "nan"])
def test_a_file_that_is_no_good_state_is_refused_in_one_sentence(killed: Killed, tmp_path: Path, kind: str) -> None:
    file, good = tmp_path / "imu.state", killed.file.read_bytes()
    if kind == "truncated":
        file.write_bytes(good[:-100])
    elif kind == "empty":
        file.touch()
    elif kind == "huge":
        with file.open("wb") as made:
            made.truncate(1 << 33)
    elif kind == "foreign":
        file.write_text("[bus]\nname = 'linux:1'\n")
    elif kind == "folder":
        file.mkdir()
    elif kind == "pipe":
        os.mkfifo(file)
    elif kind == "link":
        file.symlink_to(killed.file)
    elif kind == "bit":
        file.write_bytes(good[:200] + bytes([good[200] ^ 4]) + good[201:])
    else:
        write_state(file, msgspec.structs.replace(read_state(killed.file), force_m_s2=(float("nan"), 0.0, 0.0)))
    assert_afresh(started_again(killed, tmp_path), "not used: ")


def test_a_disk_that_takes_nothing_is_told_once_and_the_loop_goes_on(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    settings = msgspec.structs.replace(PLAIN, service=ServiceSettings(state_file=str(gone / "imu.state")))
    bed = Bed(TurnedOnce(), settings=settings, environ={"QUAVELET_BOOT_ID": BOOT})
    bed.clock.at(25.0, gone.mkdir)
    bed.run(until_s=32)
    told = [line for line in bed.said if "kept" in line]
    assert len(told) == 2 and "cannot be written" in told[0] and "kept for a restart again" in told[1]
    assert len(bed.messages) > 3100
    assert read_state(gone / "imu.state").still


def test_where_no_place_is_known_nothing_is_kept_and_nothing_told(tmp_path: Path) -> None:
    bed = Bed(settings=PLAIN, environ={"QUAVELET_BOOT_ID": BOOT})
    bed.run(until_s=1)
    assert bed.service.continuity is None and bed.said == []
    assert list(tmp_path.iterdir()) == []


def test_a_board_that_comes_to_rest_is_kept_soon_and_not_at_every_message(tmp_path: Path) -> None:
    bed = Bed(TurnedOnce(), settings=PLAIN, environ={"RUNTIME_DIRECTORY": str(tmp_path), "QUAVELET_BOOT_ID": BOOT})
    bed.run(until_s=30)
    still_s = next(m.t_ns for m in bed.messages if m.t_ns > 7e9 and m.still) / 1e9
    assert bed.service.continuity is not None
    (stats,) = bed.service.continuity.stats()
    assert 3 <= stats.delivered <= 8
    assert still_s < 20
