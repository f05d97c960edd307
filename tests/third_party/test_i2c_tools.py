"""Debian's i2c-tools, unchanged, on the fake as /dev/i2c-1."""

from __future__ import annotations

import shutil
import subprocess
import sys

import pytest

TOOLS = ("i2cdetect", "i2cget", "i2cset", "i2cdump", "i2ctransfer")
missing = [name for name in TOOLS if not shutil.which(name)]

pytestmark = [
    pytest.mark.skipif(bool(missing), reason=f"no {', '.join(missing)}: apt install i2c-tools"),
    pytest.mark.skipif(
        not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="no C compiler: apt install gcc libc6-dev"
    ),
]


def run(script: str, *options: str) -> str:
    """What a shell's commands print, all on one chip that lies still and has no errors; they must end well."""
    serve = [sys.executable, "-m", "hw_fakes", "serve", "--scenario", "still", "--perfect", "--as", "i2c-dev", *options]
    done = subprocess.run([*serve, "--", "sh", "-ec", script], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


@pytest.mark.parametrize("how", ["", "-q", "-r"])
@pytest.mark.parametrize("address", [0x68, 0x69])
def test_i2cdetect_finds_another_address(how: str, address: int) -> None:
    cells = [
        cell for line in run(f"i2cdetect -y {how} 1", f"--address={address}").splitlines()[1:] for cell in line.split()
    ]
    assert [cell for cell in cells if not cell.endswith(":") and cell != "--"] == [f"{address:x}"]


def test_i2cdetect_lists_another_adapters_functions() -> None:
    table = run("i2cdetect -F 1")
    lacking = [line.rsplit(maxsplit=1)[0].rstrip() for line in table.splitlines() if line.endswith(" no")]
    assert lacking == ["SMBus Block Read", "SMBus Block Process Call", "SMBus PEC"]


def test_i2cget_reads_what_i2cset_did_not_write() -> None:
    told = run(
        "i2cget -y 1 0x68 0x75; i2cset -y 1 0x68 0x6b 1; i2cset -y 1 0x68 0x19 0x0304 w; i2cget -y 1 0x68 0x19 w;"
        "i2cset -y 1 0x68 0x19 9 2 0x18 0x10 i; i2cget -y 1 0x68 0x19 i 4; i2cset -y 1 0x68 0x19; i2cget -y 1 0x68"
    )
    assert told.splitlines() == ["0x68", "0x0304", "0x09 0x02 0x18 0x10", "0x09"]


def test_i2cset_reads_back_another_value_than_it_wrote() -> None:
    assert "Value 0x05 written, readback matched" in run("i2cset -y 1 0x68 0x6b 1; i2cset -r -y 1 0x68 0x19 5")


@pytest.mark.parametrize(
    ("mode", "power", "identity"),
    [
        ("b", "01", "68"),
        ("w", "0001", "0068"),  # a word begins at each register; its low byte is that register's
        ("i", "01", "00"),  # a burst that reaches the FIFO's port at 0x74 stays there
    ],
)
def test_i2cdump_shows_another_chip(mode: str, power: str, identity: str) -> None:
    rows = {
        line[:2]: line[3:].split()
        for line in run(f"i2cset -y 1 0x68 0x6b 1; i2cdump -y 1 0x68 {mode}").splitlines()[1:]
    }
    if mode == "w":  # eight words a line
        assert (rows["68"][3], rows["70"][5]) == (power, identity)
    else:
        assert (rows["60"][0xB], rows["70"][5]) == (power, identity)


def test_i2ctransfer_reads_another_gravity() -> None:
    script = """
        i2ctransfer -y 1 w2@0x68 0x6b 1
        for _ in $(seq 500); do
            all=$(i2ctransfer -y 1 w1@0x68 0x3b r14)
            case $all in "0x00 0x00 0x00 0x00 0x40"*) break; esac
        done
        echo $all
    """
    words = [int(byte, 16) for byte in run(script).split()]
    assert words[:6] == [0, 0, 0, 0, 0x40, 0]  # 1 g is 16384
    assert words[8:] == [0] * 6


def test_i2ctransfer_gets_an_answer_from_where_nobody_is() -> None:
    told = run("i2ctransfer -y 1 r1@0x50 2>&1 || echo failed; i2cget -y 1 0x69 0 2>&1 || echo failed")
    assert told.splitlines() == [
        "Error: Sending messages failed: Remote I/O error",
        "failed",
        "Error: Read failed",
        "failed",
    ]
