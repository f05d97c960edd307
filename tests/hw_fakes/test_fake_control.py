"""The control line of a served fake: each command does what it says, and nothing that is sent ends the server."""

from __future__ import annotations

import io
import re
import socket
import sys
from pathlib import Path

import numpy as np
import pytest

from hw_fakes import PERFECT, FakeMpu6050, Still
from hw_fakes.__main__ import main
from hw_fakes.chip.counts import RecordedCounts
from hw_fakes.scenarios import counts_chip
from hw_fakes.serve.control import LONGEST_LINE, control_socket
from hw_fakes.serve.control_words import ControlWords
from hw_fakes.wire.adapter import READ, Adapter
from hw_fakes.world.motion_switched import SwitchedMotion
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import SettingsError


class World:
    """Two chips on an adapter in virtual time, and the words that go to it."""

    def __init__(self) -> None:
        self.clock = VirtualClock()
        chips = {at: self.chip(roll_deg) for at, roll_deg in ((0x68, 0), (0x69, 45))}
        self.adapter = Adapter(chips, clock=self.clock)
        self.say = ControlWords(self.adapter).answer

    def chip(self, roll_deg):
        motion = SwitchedMotion(Still(roll_deg=roll_deg))
        return FakeMpu6050(self.clock, motion=motion, imperfections=PERFECT, pll_error=0.0)

    def read(self, register, address=0x68, n=1):
        return self.adapter.transfer([(address, 0, bytes([register])), (address, READ, n)])[1]

    def wake(self, address=0x68):
        for register, value in ((0x6B, 1), (0x1A, 1), (0x19, 0)):
            self.adapter.transfer([(address, 0, bytes([register, value]))])

    def wait(self, seconds):
        self.clock.advance_ns(round(seconds * 1e9))

    def state(self, address=0x68):
        (line,) = re.findall(rf"^0x{address:02x} (.*)$", self.say("state"), flags=re.M)
        return dict(word.split("=") for word in line.split())


@pytest.fixture
def world():
    return World()


def test_state_is_not_that_of_the_chip(world):
    assert world.state()["awake"] == "0"
    world.wake(0x69)
    for register, value in ((0x23, 0x78), (0x6A, 0x40)):
        world.adapter.transfer([(0x69, 0, bytes([register, value]))])
    world.wait(0.0505)
    state = world.state(0x69)
    assert (state["chip"], state["awake"], state["rate_hz"], state["fifo"]) == ("MPU-6050", "1", "1000.000", "600")
    assert int(state["samples"]) == pytest.approx(51, abs=1)
    assert [state[name] for name in ("roll_deg", "pitch_deg", "yaw_deg", "x_deg_s")] == [
        "45.00",
        "0.00",
        "0.00",
        "0.00",
    ]
    assert re.match(r"ok time_s=0\.0\d\d transfers=5 happened=0\n", world.say("state"))


def test_a_chip_goes_on_as_before_though_told_to_move(world):
    world.wake()
    world.wait(3)
    before = world.read(0x3B, n=14)
    assert world.say("motion turntable 0x68") == "ok turntable at 0x68"
    world.wait(1.5 + 5 + 4)  # the turn, the rest before the table starts
    assert world.state()["z_deg_s"] == "30.00"
    assert int.from_bytes(world.read(0x47, n=2), "big", signed=True) == pytest.approx(30 * 131, abs=2)
    assert before != world.read(0x3B, n=14)
    assert world.state(0x69)["z_deg_s"] == "0.00"
    assert world.say("motion tilt") == "ok tilt at 0x68, 0x69"


def test_the_attitude_jumps_when_told_to_move(world):
    world.say("motion sway 0x69")
    rolls = []
    for _ in range(150):
        rolls.append(float(world.state(0x69)["roll_deg"]))
        world.wait(0.01)
    assert (rolls[0], rolls[-1]) == (45, pytest.approx(0, abs=0.1))
    assert np.abs(np.diff(rolls)).max() < 45 * 1.875 / 150 + 0.03


def test_samples_computed_ahead_show_the_old_motion(world):
    world.wake(0x69)
    world.wait(3)
    assert world.read(0x3D, 0x69, 2) != b"\0\0"
    world.say("motion still 0x69")
    world.wait(0.9)
    y, z = np.frombuffer(world.read(0x3D, 0x69, 4), dtype=">i2")
    assert np.degrees(np.arctan2(y, z)) == pytest.approx(float(world.state(0x69)["roll_deg"]), abs=0.3)
    assert np.degrees(np.arctan2(y, z)) < 40


def test_state_is_that_of_the_last_transfer(world):
    world.wake()
    world.say("fault asleep at=1 address=0x68")
    world.wait(2)
    assert world.state()["awake"] == "0"
    assert len(world.say("state").splitlines()) == 3


def test_recorded_counts_are_told_to_move(world):
    words = np.zeros((9, 3), dtype=np.int16)
    counts = RecordedCounts(
        acc=words, gyr=words, temp=words[:, 0], acc_lsb_per_g=16384, gyr_lsb_per_dps=131, rate_hz=100
    )
    world.adapter.attach(0x6A, counts_chip(counts, clock=world.clock))
    assert world.say("motion walk") == "error the chip at 0x6a does not move, it plays what was recorded: serve another"
    assert "roll_deg" not in world.state(0x6A)
    assert world.state(0x68)["roll_deg"] == "0.00", "another chip was moved though the command is refused"


def test_a_fault_told_is_not_the_one_that_comes(world):
    assert world.say("fault flip register=0x75 bit=0") == "ok flip register=0x75 bit=0"
    assert world.read(0x75) == b"\x69"
    assert world.read(0x75) == b"\x68"
    assert re.fullmatch(
        r"ok 1 happened\n0\.000000 flip 0x68 register=0x75 byte=0 bit=0 0x68 for 0x69", world.say("history")
    )


def test_a_plan_told_is_not_in_the_state_or_stays_after_clear(world):
    world.say("fault nack every=2 for=0.5")
    world.say("fault unplugged address=0x69")
    state = world.say("state").splitlines()
    assert state[3:] == ["lasts unplugged 0x69", "plan nack every=2 for=0.5"]
    assert world.say("clear") == "ok"
    assert len(world.say("state").splitlines()) == 3
    world.wait(2.1)
    assert world.read(0x75, 0x69) == b"\x68"


def test_plugging_is_another_than_unplugging(world):
    assert world.say("unplug 0x69") == "ok off the wires: 0x69"
    assert world.read(0x75) == b"\x68"
    with pytest.raises(OSError):
        world.read(0x75, 0x69)
    assert world.say("plug") == "ok on the wires: 0x69"
    assert world.read(0x75, 0x69) == b"\x68"
    assert world.say("plug") == "error nothing is unplugged"
    assert [line.split()[1:] for line in world.say("history").splitlines()[1:]] == [
        ["unplugged", "0x69", "off", "the", "wires"],
        ["unplugged", "0x69", "over"],
    ]


def test_history_shows_another_end(world):
    for _ in range(5):
        world.say("unplug 0x68")
        world.say("plug")
    assert world.say("history").startswith("ok 10 happened\n")
    assert world.say("history 3").splitlines()[1:] == world.say("history").splitlines()[-3:]
    assert world.say("history 0") == "ok 10 happened"


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("", "there is no command '': take one of motion, fault, clear, history, unplug, plug, state, help"),
        ("jump", "there is no command 'jump'"),
        ("motion", "there is no motion '': take one of still"),
        ("motion flight", "there is no motion 'flight': take one of still, tilt"),
        ("motion walk 0x50", "there is no chip at 0x50: take 0x68, 0x69"),
        ("motion motion:no.npz", "there is no recording no.npz"),
        ("fault", "there is no fault ''"),
        ("fault nack at=x", "'x' in 'at=x' is not a number"),
        ("fault brown-out address=0x50", "there is no MPU-6050 at 0x50"),
        ("unplug everything", "'everything' is no address: write one as 0x68"),
        ("plug 0x51", "there is no chip at 0x51"),
        ("history some", "'some' is no number of faults"),
        ("history -1", "'-1' is no number of faults"),
        ("clear all", "clear takes nothing more, not 'all'"),
        ("state please", "state takes nothing more"),
    ],
)
def test_a_wrong_line_is_no_sentence(world, line, says):
    answer = world.say(line)
    assert answer.startswith("error ")
    assert says in answer
    assert "\n" not in answer


def test_a_fault_of_the_past_waits(world):
    world.read(0x75)
    world.wait(10)
    assert "is past, it is 10.000 s" in world.say("fault nack at=5")


def test_an_error_within_ends_the_server(world, monkeypatch):
    monkeypatch.setattr(world.adapter.faults, "clear", lambda: 1 / 0)
    assert world.say("clear") == "error the fake failed: ZeroDivisionError('division by zero')"


def test_every_command_is_missing_in_the_help(world):
    lines = world.say("help").splitlines()[1:]
    known = world.say("?").partition("take one of ")[2].split(", ")
    assert [line.split()[0] for line in lines] == known


# The socket


@pytest.fixture
def path(tmp_path):
    return str(tmp_path / "control")


def test_the_command_and_the_socket_do_not_understand_each_other(world, path, capsys, monkeypatch):
    with control_socket(path, world.adapter):
        assert main(["control", path, "motion", "walk"]) == 0
        assert main(["control", path, "fault nack for=2"]) == 0
        assert main(["control", path, "jump"]) == 1
        assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == ["ok", "ok", "error"]
        monkeypatch.setattr(sys, "stdin", io.StringIO("help\n\nnonsense\nclear\n"))
        assert main(["control", path]) == 1
        lines = capsys.readouterr().out.splitlines()
        assert (lines[0].strip(), lines[-2].split()[0], lines[-1]) == ("ok", "error", "ok")
    assert not Path(path).exists()
    assert main(["control", path, "state"]) == 125
    assert f"nobody takes lines at {path}" in capsys.readouterr().err


def test_wild_bytes_end_the_server(world, path):
    with control_socket(path, world.adapter):
        for wild in (b"\xff\xfe\0\n", b"x" * 3 * LONGEST_LINE + b"\n", b"no end of line", b""):
            with socket.socket(socket.AF_UNIX) as connection:
                connection.connect(path)
                connection.sendall(wild)
                connection.shutdown(socket.SHUT_WR)
                answers = b""
                while part := connection.recv(65536):
                    answers += part
                assert all(line.startswith(b"error") for line in answers.splitlines() if line)
        with socket.socket(socket.AF_UNIX) as gone:
            gone.connect(path)
            gone.sendall(b"help\n" * 1000)
        assert main(["control", path, "state"]) == 0


def test_two_who_ask_wait_for_each_other_to_leave(world, path, capsys):
    with control_socket(path, world.adapter), socket.socket(socket.AF_UNIX) as idle:
        idle.connect(path)
        assert main(["control", path, "help"]) == 0
    assert capsys.readouterr().out.startswith("ok")


def test_another_user_may_connect(world, path):
    with control_socket(path, world.adapter):
        assert Path(path).stat().st_mode & 0o777 == 0o600


def test_a_path_in_use_is_taken_over(world, path, tmp_path):
    with (
        control_socket(path, world.adapter),
        pytest.raises(SettingsError, match="that takes lines at"),
        control_socket(path, world.adapter),
    ):
        pass
    file = tmp_path / "file"
    file.write_text("mine")
    for wrong in (str(file), str(tmp_path / "none" / "x"), str(tmp_path / ("x" * 120))):
        with pytest.raises(SettingsError, match="there can be no control socket"), control_socket(wrong, world.adapter):
            pass
    assert file.read_text() == "mine"


def test_a_socket_left_behind_is_in_the_way(world, path):
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(path)
    with control_socket(path, world.adapter):
        assert main(["control", path, "state"]) == 0
