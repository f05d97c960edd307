"""`quavelet doctor` passes a good board, and gives advice for each thing that is not well."""

import fcntl
import json
import os
import pty
import re
import signal
import struct
import subprocess
import termios

from program import PROGRAM, quavelet

from quavelet.cli import exits


def test_a_good_board_passes_in_all_points_and_is_told_what_comes_next() -> None:
    done = quavelet("doctor", "--bus", "fake:still", "--virtual-time")
    assert (done.code, done.err) == (exits.OK, "")
    assert all(line.startswith("ok ") for line in done.lines), done.out
    assert "all is well in" in done.lines[-1]
    assert "NOT A REAL ONE" in done.lines[-1]
    assert done.lines[-1].endswith("next: quavelet run --bus fake:still")


def test_a_moving_board_is_told_to_lie_still() -> None:
    done = quavelet("doctor", "--bus", "fake:sway", "--virtual-time")
    assert (done.code, done.err) == (exits.VERDICT_FAILED, "")
    lines = done.lines
    (moving,) = [i for i, line in enumerate(lines) if line.startswith("BAD  board still")]
    assert "-> lay it down" in lines[moving + 1]
    assert lines[-2].startswith("BAD  verdict")
    assert "do what stands under 'board still'" in lines[-1]


def test_a_board_that_is_not_there_ends_the_check_up_with_the_reason() -> None:
    done = quavelet("doctor", "--bus", "fake:still", "--address", "0x69", "--virtual-time")
    assert (done.code, done.err) == (exits.NO_DEVICE, "")
    assert done.lines[0].startswith("ok   bus")
    assert done.lines[1].startswith("BAD  who answers         0x69 is silent, 0x68 answers")
    assert done.lines[2].strip() == "-> AD0 is low: give --address 0x68"


def test_a_board_unplugged_meanwhile_is_lost(with_odd_buses: dict[str, str]) -> None:
    done = quavelet("doctor", "--bus", "odd:dying", env=with_odd_buses)
    assert done.code == exits.DEVICE_LOST
    assert any("no answer" in line for line in done.said)
    assert any(line.startswith("BAD  stopped") for line in done.lines)


def test_an_unknown_chip_is_driven_where_its_id_is_accepted(with_odd_buses: dict[str, str]) -> None:
    refused = quavelet("doctor", "--bus", "odd:another_chip", env=with_odd_buses)
    assert (refused.code, refused.lines[2][:14]) == (exits.NO_DEVICE, "BAD  WHO_AM_I ")
    accepted = quavelet("doctor", "--bus", "odd:another_chip", "--accept-id", "0x19", env=with_odd_buses)
    assert accepted.lines[2].startswith("ok   WHO_AM_I            0x19, ")


def test_every_bad_finding_has_advice_and_no_good_one_has() -> None:
    done = quavelet("doctor", "--bus", "fake:sway", "--virtual-time", "--json")
    findings = [json.loads(line) for line in done.lines]
    assert {finding["name"] for finding in findings if not finding["ok"]} == {"board still", "verdict"}
    assert [f["name"] for f in findings if f["ok"] == bool(f["advice"])] == []
    (speed,) = [finding["figures"] for finding in findings if finding["name"] == "wire speed"]
    assert speed == {"bus_hz": 400_000}


def test_on_a_terminal_no_line_is_broken_by_its_edge() -> None:
    for columns in (60, 100):
        lines = on_terminal("doctor", "--bus", "fake:sway", "--virtual-time", columns=columns)
        assert max(map(len, lines)) <= columns
        assert any(line.startswith("BAD  board still") for line in lines)


def test_ctrl_c_ends_it_without_a_trace() -> None:
    with subprocess.Popen(
        [PROGRAM, "doctor", "--bus", "fake:still"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith("ok   chip"):
                break
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=30)
    assert process.returncode == exits.INTERRUPTED
    assert (out, err) == ("", "")


def on_terminal(*arguments: str, columns: int) -> list[str]:
    """What a terminal of this width gets, without colours."""
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    environment = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
    with subprocess.Popen([PROGRAM, *arguments], stdout=slave, stderr=slave, env=environment) as process:
        os.close(slave)
        got = bytearray()
        while chunk := _read(master):
            got += chunk
    os.close(master)
    assert process.returncode == exits.VERDICT_FAILED
    return re.sub(r"\x1b\[[0-9;]*m", "", got.decode()).replace("\r", "").splitlines()


def _read(fd: int) -> bytes:
    try:
        return os.read(fd, 4096)
    except OSError:  # Linux ends a terminal nobody holds any more so
        return b""
