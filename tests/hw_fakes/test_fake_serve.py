"""`python -m hw_fakes serve` and `list`: the chips that were asked for, and one sentence for what cannot be."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest

import hw_fakes.__main__
from hw_fakes import FakeMpu6050
from hw_fakes.__main__ import main
from hw_fakes.boards import BOARDS
from hw_fakes.chip.personalities import PERSONALITIES
from hw_fakes.faults.plan import KINDS
from hw_fakes.scenarios import MOTIONS
from hw_fakes.serve import serving as serve
from hw_fakes.serve.serving import Making, new_chip
from hw_fakes.wire.adapter import READ, Adapter
from quavelet.core.clock import MonotonicClock, VirtualClock

needs_compiler = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="no C compiler: apt install gcc libc6-dev"
)
STILL = ["serve", "--scenario", "still"]


def run(program, *options):
    return main(
        ["serve", *options, "--", sys.executable, "-c", f"import smbus2, sys\nbus = smbus2.SMBus(1)\n{program}"]
    )


@needs_compiler
def test_the_second_chip_is_missing_or_of_another_family():
    program = "sys.exit([bus.read_byte_data(at, 0x75) for at in (0x68, 0x69, 0x6a)] != [0x70] * 3)"
    chips = ["--scenario", "tilt", "--chip", "0x69=walk", "--chip", "0x6a=still"]
    assert run(program, *chips, "--personality", "MPU-6500") == 0


@needs_compiler
def test_a_planned_fault_does_not_reach_the_program(tmp_path):
    program = """
def code():
    try:
        return bus.read_byte_data(0x68, 0x75)
    except OSError as error:
        return error.errno
sys.exit([code() for _ in range(4)] != [110, 110, 5, 0x68])
"""
    file = tmp_path / "faults"
    file.write_text("# a bad day\neio at=0\n", encoding="utf-8")
    assert run(program, "--scenario", "still", "--fault-file", str(file), "--faults", "time-out n=2 takes=0.01") == 0


@needs_compiler
def test_the_control_line_does_not_reach_a_running_program(tmp_path):
    path = str(tmp_path / "control")
    program = f"""
import subprocess
said = subprocess.run([sys.executable, "-m", "hw_fakes", "control", {path!r}, "unplug"], capture_output=True, text=True)
assert said.stdout == "ok off the wires: 0x68\\n", said
try:
    bus.read_byte_data(0x68, 0x75)
except OSError as error:
    sys.exit(error.errno)
"""
    assert run(program, "--scenario", "still", "--control", path) == 121
    assert not os.path.exists(path)  # noqa: PTH110


@needs_compiler
def test_a_transfer_at_100_khz_takes_no_time():
    program = """
import time
begun = time.monotonic()
for _ in range(10):
    bus.read_i2c_block_data(0x68, 0x0d, 32)
sys.exit(not 10 * 318e-5 < time.monotonic() - begun)
"""
    assert run(program, "--scenario", "still", "--speed", "100000") == 0


@needs_compiler
def test_a_boards_magnetometer_is_missing_or_there_without_the_bypass():
    program = """
def code(at, register):
    try:
        return bus.read_byte_data(at, register)
    except OSError as error:
        return error.errno
before = code(0x0d, 0x0d)
bus.write_byte_data(0x68, 0x6b, 1)
bus.write_byte_data(0x68, 0x37, 2)
sys.exit([before, code(0x0d, 0x0d)] != [121, 0xff])
"""
    assert run(program, "--scenario", "still", "--board", "gy-87") == 0


def test_two_chips_of_one_seed_are_the_same_board(monkeypatch):
    served = []
    monkeypatch.setattr(hw_fakes.__main__, "run_with_device", lambda *_, adapter, **__: served.append(adapter))
    main([*STILL, "--chip", "0x69=still", "--seed", "4", "--", "true"])
    main(["serve", "--chip", "0x69=still", "--seed", "5", "--", "true"])
    first, second = (served[0].targets[at] for at in (0x68, 0x69))
    assert first.imperfections != second.imperfections
    assert served[1].targets[0x69].imperfections == second.imperfections


def test_a_paced_adapter_is_late_or_early():
    # A read of 32 bytes is 318 bit-times: 3.18 ms.
    clock = MonotonicClock()
    for paced, least_s in ((True, 3.18e-3), (False, 0)):
        adapter = Adapter({0x68: FakeMpu6050(clock)}, clock=clock, speed_hz=100_000, paced=paced)
        begun_ns = clock.now_ns()
        adapter.transfer([(0x68, 0, b"\x00"), (0x68, READ, 32)])
        assert (clock.now_ns() - begun_ns) / 1e9 >= least_s
        assert adapter.busy_ns == 3_180_000


def words(chip, clock):
    for data in (b"\x6b\x01", b"\x1a\x03"):
        chip.write(data)
        chip.stop()
    clock.advance_ns(10**9)
    chip.write(b"\x3b")
    return np.frombuffer(chip.read(14), dtype=">i2")


def test_a_seed_is_no_other_board_or_not_the_same_again():
    found = []
    for seed in (None, None, 1, 1, 2):
        clock = VirtualClock()
        found.append(words(new_chip("still", clock=clock, making=Making(seed=seed)), clock).tolist())
    assert found[0] == found[1]
    assert found[2] == found[3]
    assert len({tuple(one) for one in found}) == 3


def test_the_oscillator_is_as_good_as_any():
    for making, hz in ((Making(rate_error=-0.04), 960), (Making(perfect=True), 1000), (Making(), 1007)):
        clock = VirtualClock()
        chip = new_chip("still", clock=clock, making=making)
        words(chip, clock)
        assert chip.true_rate_hz() == pytest.approx(hz)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--chip", "0x68=walk"], "two chips at 0x68: pull AD0"),
        (["--chip", "0x69=storm"], "there is no 'fake:storm': take one of fake:still"),
        (["--personality", "BMI160"], "there is no personality 'BMI160': take one of MPU-6050"),
        (["--board", "gy-1"], "there is no board 'gy-1': take one of gy-521"),
        (["--rate-error", "nan"], "a rate error of nan is none of a chip"),
        (["--rate-error", "2"], "a rate error of 2.0 is none of a chip"),
        (["--seed", "-1"], "seed -1 is below 0"),
        (["--faults", "nak"], "there is no fault 'nak': take one of nack"),
        (["--faults", "nack at=soon"], "'soon' in 'at=soon' is not a number"),
        (["--faults", "brown-out address=0x69"], "there is no MPU-6050 at 0x69"),
        (["--fault-file", "/nowhere"], "the faults in /nowhere cannot be read"),
        (["--control", "/nowhere/x"], "there can be no control socket /nowhere/x"),
        (["--control", "/tmp/" + 120 * "x"], "AF_UNIX path too long"),
    ],
)
def test_bad_use_is_a_traceback(arguments, says, capsys):
    assert main([*STILL, *arguments, "--", "true"]) == 125
    said = capsys.readouterr()
    assert says in said.err
    assert said.err.count("\n") == 1
    assert said.out == ""


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["serve", "--", "true"], "there is no chip to serve: write --scenario NAME, or --chip ADDRESS=NAME"),
        (["serve", "--chip", "walk", "--", "true"], "'walk' is no chip at an address: write one as 0x69=walk"),
        (["serve", "--chip", "x=walk", "--", "true"], "'x=walk' is no chip at an address"),
        ([*STILL, "--speed", "10", "--", "true"], "10 Hz is no speed of I2C wires: take 100000 or 400000"),
        ([*STILL, "--as", "usbip", "--bus", "3"], "the kernel gives the number of its adapter: leave --bus out"),
        ([*STILL, "--chip", "0x69=walk", "--board", "gy-87", "--", "true"], "two boards have a magnetometer at one"),
        ([*STILL, "--personality", "MPU-6500", "--board", "gy-87", "--", "true"], "not allowed with"),
        (["control"], "required: PATH"),
        ([], "required: COMMAND"),
    ],
)
def test_a_command_that_is_none_is_run(arguments, says, capsys):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert says in capsys.readouterr().err


def test_list_leaves_something_out(capsys):
    assert main(["list"]) == 0
    rows = [line.split(maxsplit=2) for line in capsys.readouterr().out.splitlines()]
    named = {
        group: {row[1] for row in rows if row[0] == group} for group in ("scenario", "personality", "board", "fault")
    }
    assert named["scenario"] == {*MOTIONS, "motion:FILE.npz", "counts:FILE.npz"}
    assert named["personality"] == {chip.name for chip in PERSONALITIES}
    assert named["board"] == set(BOARDS)
    assert named["fault"] == set(KINDS)
    assert all(len(row) == 3 for row in rows)


@pytest.fixture
def kernel(monkeypatch):
    """A kernel that takes the adapter as /dev/i2c-7; what it found there."""
    found = []

    @contextmanager
    def attached(adapter):
        found.append(adapter.transfer([(0x68, 0, b"\x75"), (0x68, READ, 1)])[1])
        yield 7
        found.append("detached")

    monkeypatch.setattr(serve, "attached_usbip", attached)
    return found


def test_a_program_beside_the_kernels_adapter_is_not_told_its_number(kernel):
    program = "import os, sys; sys.exit(int(os.environ['HW_FAKES_I2C_BUS']) + ('LD_PRELOAD' in os.environ))"
    assert main([*STILL, "--as", "usbip", "--", sys.executable, "-c", program]) == 7
    assert main([*STILL, "--as", "usbip", "--", "no-such-program"]) == 127
    assert kernel == 2 * [b"\x68", "detached"]


@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_the_kernels_adapter_stays_after_a_signal(kernel, capsys, sign):
    def end():
        while not kernel:
            time.sleep(0.01)
        time.sleep(0.1)
        os.kill(os.getpid(), sign)

    before = signal.getsignal(sign)
    signal.signal(sign, signal.SIG_IGN)  # one that came before it was waited for must not end the tests
    try:
        thread = threading.Thread(target=end)
        thread.start()
        assert main([*STILL, "--as", "usbip"]) == 0
        thread.join()
    finally:
        signal.signal(sign, before)
    said = capsys.readouterr()
    assert said.out == "7\n"
    assert "the fake is /dev/i2c-7; Ctrl-C, or SIGTERM, takes it away" in said.err
    assert kernel == [b"\x68", "detached"]


@needs_compiler
def test_ctrl_c_leaves_a_traceback_of_the_fake(tmp_path):
    program = [sys.executable, "-c", "import signal; print('ready', flush=True); signal.pause()"]
    path = tmp_path / "control"
    command = [sys.executable, "-m", "hw_fakes", *STILL, "--control", str(path), "--", *program]
    # A shell's background job ignores Ctrl-C, and so would what it starts.
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        served = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
    finally:
        signal.signal(signal.SIGINT, before)
    with served:
        assert served.stdout is not None
        assert served.stdout.readline() == "ready\n"
        os.killpg(served.pid, signal.SIGINT)
        err = served.communicate(timeout=30)[1]
    assert served.returncode == 128 + signal.SIGINT
    assert "hw_fakes" not in err
    assert not path.exists()
