"""The check-up by way of /dev/i2c-1, smbus2 and the kernel's refusals, with the kernel in this process."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from hw_fakes import NOISE_ONLY, FakeMpu6050
from hw_fakes.ways.in_process import PatchedKernel
from hw_fakes.wire.adapter import Adapter
from quavelet.bench.checkup import CheckUp
from quavelet.bench.finding import Finding
from quavelet.bench.host import Host
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import BusBusy, BusPermission, DeviceMissing, ImuError
from quavelet.settings import BusSettings, Settings


def checked(
    root: Path, *, device: int | None = None, held: tuple[int, ...] = (), nack: int = errno.EREMOTEIO, at: int = 0x68
) -> tuple[dict[str, Finding], ImuError | None, PatchedKernel]:
    """The findings on linux:1 by name; `device` is an errno that opening it is refused with."""
    clock = VirtualClock()
    chip = FakeMpu6050(clock, imperfections=NOISE_ONLY, seed=3)
    adapter = Adapter({at: chip}, clock=clock, nack_errno=nack)
    kernel = PatchedKernel({"/dev/i2c-1": device or adapter}, replace=["quavelet.bus.linux.ioctl"])
    kernel.held = set(held)
    with kernel.installed():
        check = CheckUp(Settings(bus=BusSettings(name="linux:1")), clock=clock, host=Host(root))
        findings = {finding.name: finding for finding in check.findings()}
    return findings, check.error, kernel


@pytest.mark.parametrize("nack", [errno.EREMOTEIO, errno.ENXIO])
def test_a_good_board_passes(nack: int, tmp_path: Path) -> None:
    findings, error, kernel = checked(tmp_path, nack=nack)
    assert error is None
    assert [finding.name for finding in findings.values() if not finding.ok or finding.advice] == []
    assert findings["wire speed"].figures["bus_hz"] == pytest.approx(400_000, rel=0.001)
    assert not kernel.open_files, "left open"


@pytest.mark.parametrize("nack", [errno.EREMOTEIO, errno.ENXIO])
def test_a_board_at_the_other_address_is_found(nack: int, tmp_path: Path) -> None:
    findings, error, _ = checked(tmp_path, nack=nack, at=0x69)
    assert "give --address 0x69" in findings["who answers"].advice
    assert isinstance(error, DeviceMissing)


def test_an_address_that_a_driver_holds_is_not_read_past_it(tmp_path: Path) -> None:
    findings, error, kernel = checked(tmp_path, held=(0x68,))
    assert "held by the kernel" in findings["who answers"].found
    assert isinstance(error, BusBusy)
    assert all(address != 0x68 for messages in kernel.transactions for address, _, _ in messages)


def test_a_neighbour_that_a_driver_holds_does_not_matter(tmp_path: Path) -> None:
    findings, error, _ = checked(tmp_path, held=(0x77,))
    assert (findings["who answers"].ok, error) == (True, None)


def test_a_device_that_may_not_be_opened_is_a_matter_of_the_group(tmp_path: Path) -> None:
    findings, error, _ = checked(tmp_path, device=errno.EACCES)
    assert list(findings) == ["bus"]
    assert "group i2c" in findings["bus"].advice
    assert isinstance(error, BusPermission)
