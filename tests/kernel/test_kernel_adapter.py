"""The fake as a kernel's own /dev/i2c-N, in a guest: unchanged programs above the kernel's I2C core."""

from __future__ import annotations

import json
import shutil

import pytest
from boot import Guest

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

needs_tools = pytest.mark.skipif(not shutil.which("i2cdetect"), reason="no i2cdetect: apt install i2c-tools")


@needs_tools
def test_the_kernel_lists_another_adapter(guest: Guest) -> None:
    read = guest.read("i2c_tools")
    code, listed, _ = read["list"]
    assert code == 0
    assert [line.split()[:3] for line in listed.splitlines() if line.startswith(f"i2c-{read['number']}\t")] == [
        [f"i2c-{read['number']}", "i2c", "i2c-tiny-usb"]
    ]
    lacking = [
        line.rsplit(maxsplit=1)[0].rstrip() for line in read["functions"][1].splitlines() if line.endswith(" no")
    ]
    assert lacking == ["SMBus Block Read", "SMBus Block Process Call", "SMBus PEC"]


@needs_tools
def test_i2cdetect_finds_another_address_above_a_kernel(guest: Guest) -> None:
    code, grid, _ = guest.read("i2c_tools")["quick"]
    cells = [cell for line in grid.splitlines()[1:] for cell in line.split()]
    assert code == 0
    assert [cell for cell in cells if not cell.endswith(":") and cell != "--"] == ["68"]


@needs_tools
def test_a_program_reads_other_bytes_above_a_kernel(guest: Guest) -> None:
    read = guest.read("i2c_tools")
    assert read["wake"] == read["block"] == [0, "", ""]
    assert read["identity"] == [0, "0x68\n", ""]
    assert read["word"] == [0, "0x0209\n", ""]
    assert read["transfer"] == [0, "0x09 0x02 0x18 0x10\n", ""]
    assert read["fifo"] == [0, " ".join(["0x00"] * 1024) + "\n", ""]


@needs_tools
def test_a_kernel_gets_an_answer_from_where_nobody_is(guest: Guest) -> None:
    # i2c-tiny-usb makes ENXIO of a missing acknowledge, where a Raspberry Pi makes EREMOTEIO.
    assert guest.read("i2c_tools")["nobody"] == [
        1,
        "",
        "Error: Sending messages failed: No such device or address\n",
    ]


def test_quavelet_finds_fault_with_its_own_fake_above_a_kernel(guest: Guest) -> None:
    code, printed, complaints = guest.read("quavelet")["doctor"]
    assert complaints == ""
    findings = {finding["name"]: finding for finding in map(json.loads, printed.splitlines())}
    for name in ("bus", "chip", "registers"):
        assert findings[name]["ok"], findings[name]
    # An emulated machine may stand still for longer than the FIFO holds: then the samples prove nothing, either way.
    if findings["no sample lost"]["ok"]:
        assert code == 0, printed


def test_the_guest_ends_otherwise_than_its_command(guest: Guest) -> None:
    assert guest.ended.code == 0, guest.ended.output[-2000:]
