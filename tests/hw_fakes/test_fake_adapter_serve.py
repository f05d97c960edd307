"""A program with the fake as its /dev/i2c-N, by `python -m hw_fakes serve`: every system call, and how it all ends."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from hw_fakes import PERFECT, FakeMpu6050
from hw_fakes.__main__ import main
from hw_fakes.ways.preload import SHIM, run_with_device
from hw_fakes.wire.adapter import Adapter
from quavelet.core.clock import VirtualClock

needs_compiler = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="no C compiler: apt install gcc libc6-dev"
)

LOOKS = """
import os, stat
path = "/dev/i2c-1"
found = os.stat(path)
assert stat.S_ISCHR(found.st_mode) and (os.major(found.st_rdev), os.minor(found.st_rdev)) == (89, 1), found
assert os.lstat(path).st_rdev == found.st_rdev and os.path.exists(path) and os.access(path, os.R_OK | os.W_OK)
assert not os.path.exists("/dev/i2c-111")
fd = os.open(path, os.O_RDWR)
assert os.fstat(fd).st_rdev == found.st_rdev
os.close(fd)
"""

PLAIN = """
import fcntl
with open("/dev/i2c-1", "r+b", buffering=0) as device:
    fcntl.ioctl(device, 0x703, 0x68)
    assert device.write(b"\\x75") == 1
    assert device.read(1) == b"\\x68"
    assert device.write(b"\\x19\\x04\\x03") == 3
    device.write(b"\\x6b\\x01")
    device.write(b"\\x19\\x04\\x03")
    device.write(b"\\x19")
    assert device.read(2) == b"\\x04\\x03"
"""

SMBUS2 = """
import smbus2, threading
with smbus2.SMBus(1) as bus:
    bus.write_byte_data(0x68, 0x6b, 1)
    bus.write_i2c_block_data(0x68, 0x19, [7, 3, 0x18, 0x10])
    assert bus.read_i2c_block_data(0x68, 0x19, 4) == [7, 3, 0x18, 0x10]
    assert bus.read_word_data(0x68, 0x19) == 0x0307
    read = smbus2.i2c_msg.read(0x68, 8192)
    bus.i2c_rdwr(smbus2.i2c_msg.write(0x68, [0x74]), read)
    assert bytes(read) == bytes(8192)
    bus.i2c_rdwr(smbus2.i2c_msg.write(0x68, [0x19]), read := smbus2.i2c_msg.read(0x68, 2))
    assert bytes(read) == bytes([7, 3])
    try:
        bus.write_quick(0x69)
    except OSError as error:
        assert error.errno == 121, error
    else:
        raise AssertionError("0x69 answers")
wrong = []
def ask():
    with smbus2.SMBus(1) as bus:
        for _ in range(200):
            if (bus.read_byte_data(0x68, 0x75), bus.read_i2c_block_data(0x68, 0x19, 2)) != (0x68, [7, 3]):
                wrong.append(1)
threads = [threading.Thread(target=ask) for _ in range(4)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
assert not wrong
"""

REUSED = """
import os
fd = os.open("/dev/i2c-1", os.O_RDWR)
own = os.open("/dev/null", os.O_RDWR)
os.dup2(own, fd)
assert os.write(fd, b"123") == 3 and os.read(fd, 3) == b""
"""


@needs_compiler
@pytest.mark.parametrize("program", [LOOKS, PLAIN, SMBUS2, REUSED], ids=["looks", "plain", "smbus2", "reused"])
def test_a_program_finds_another_device_than_a_kernels(program: str) -> None:
    adapter = Adapter({0x68: FakeMpu6050(VirtualClock(), imperfections=PERFECT)})
    assert run_with_device([sys.executable, "-c", program], adapter=adapter) == 0


@needs_compiler
def test_the_bus_has_another_number_or_the_chip_another_address() -> None:
    program = "import smbus2, sys; sys.exit(smbus2.SMBus(7).read_byte_data(0x69, 0x75))"
    serve = ["serve", "--scenario", "still", "--as", "i2c-dev", "--bus", "7", "--address", "0x69", "--"]
    assert main([*serve, sys.executable, "-c", program]) == 0x68


@needs_compiler
def test_the_programs_end_is_not_told() -> None:
    serve = ["serve", "--scenario", "still", "--"]
    assert main([*serve, sys.executable, "-c", "import sys; sys.exit(7)"]) == 7
    assert main([*serve, sys.executable, "-c", "import os; os.kill(os.getpid(), 9)"]) == 128 + 9
    assert main([*serve, "no-such-program"]) == 127
    assert main([*serve, "/"]) == 126


@needs_compiler
def test_a_program_outlives_the_command_that_is_told_to_end() -> None:
    program = [sys.executable, "-c", "import signal; print('ready', flush=True); signal.pause()"]
    serve = [sys.executable, "-m", "hw_fakes", "serve", "--scenario", "still", "--"]
    with subprocess.Popen([*serve, *program], stdout=subprocess.PIPE, text=True) as served:
        assert served.stdout is not None
        assert served.stdout.readline() == "ready\n"
        served.terminate()
        # The pipe is at its end only when the program has let go of it.
        assert served.communicate(timeout=30)[0] == ""
    assert served.returncode == 128 + signal.SIGTERM


class Broken:
    def write(self, data: bytes) -> None:
        raise RuntimeError(f"not prepared for {data!r}")

    def read(self, n: int) -> bytes:
        raise RuntimeError(f"not prepared for {n}")

    def stop(self) -> None:
        pass


@needs_compiler
def test_a_fault_of_the_fake_leaves_the_program_waiting(capfd: pytest.CaptureFixture[str]) -> None:
    program = (
        "import os; fd = os.open('/dev/i2c-1', os.O_RDWR); import fcntl; fcntl.ioctl(fd, 0x703, 8)\nos.read(fd, 3)"
    )
    assert run_with_device([sys.executable, "-c", program], adapter=Adapter({8: Broken()})) == 1
    told = capfd.readouterr().err
    assert "hw_fakes: the transfer fails with EIO: RuntimeError('not prepared for 3')" in told
    assert "Input/output error" in told


@needs_compiler
def test_the_compiler_complains_about_the_shim(tmp_path: Path) -> None:
    command = [shutil.which("cc") or "gcc", "-shared", "-fPIC", "-O2", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([*command, "-o", tmp_path / "shim.so", SHIM, "-ldl", "-pthread"], check=True)


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (["serve", "--scenario", "storm", "--", "true"], 125, "there is no 'fake:storm': take one of fake:still"),
        (["serve", "--scenario", "still", "--address", "3", "--", "true"], 125, "0x03 is no address of a chip"),
        (["serve", "--scenario", "counts:no.npz", "--", "true"], 125, "no.npz"),
    ],
)
def test_what_cannot_be_served_is_not_told(
    arguments: list[str], code: int, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == code
    assert says in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["serve", "--scenario", "still"], "there is no program to run: write it after --"),
        (["serve", "--scenario", "still", "--bus", "-1", "--", "true"], "invalid"),
        (["serve", "--scenario", "still", "--as", "cuse", "--", "true"], "invalid choice: 'cuse'"),
    ],
)
def test_a_command_that_is_none_runs(arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert says in capsys.readouterr().err


def test_a_machine_without_a_compiler_is_told_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    assert main(["serve", "--scenario", "still", "--", "true"]) == 125
    assert "apt install gcc libc6-dev" in capsys.readouterr().err
