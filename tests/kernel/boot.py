"""One boot for all tests: the guest does every job and ends."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from chips import ADDRESS, steady_chip
from debian_kernel import Kernel
from guest import Ended, run_in_guest

from hw_fakes.ways.usb_redir import served_usbredir
from hw_fakes.wire.adapter import Adapter
from quavelet.core.clock import MonotonicClock

HERE = Path(__file__).resolve().parent
REPOSITORY = HERE.parents[1]
MODULES = ("uhci_hcd", "vhci-hcd", "i2c-tiny-usb", "i2c-dev", "inv-mpu6050-i2c")


@dataclass(frozen=True, slots=True)
class Guest:
    """What came of the boot.

    jobs     by name, what each printed; one that failed has "error"
    outside  what the chip that QEMU plugged in was written
    """

    kernel: Kernel
    ended: Ended
    jobs: dict[str, dict[str, Any]]
    outside: list[str]

    def read(self, job: str) -> dict[str, Any]:
        result = self.jobs.get(job, {"error": f"it was never done\n{self.ended.output[-1000:]}"})
        if "error" in result:
            pytest.fail(f"{job}: {result['error']}\nthe guest's console ends with\n{self.ended.console[-3000:]}")
        return result


def boot(kernel: Kernel, folder: Path) -> Guest:
    """All jobs in a guest, with a chip outside of it besides. `folder` is for the socket between them."""
    module = kernel.built_module(HERE / "hw_fakes_irq.c")
    chip = steady_chip(MonotonicClock())
    socket = folder / "usbredir"
    with served_usbredir(Adapter({ADDRESS: chip}), socket):
        ended = run_in_guest(
            [sys.executable, HERE / "guest_jobs.py", module],
            kernel=kernel,
            modules=MODULES,
            environment={"PYTHONPATH": f"{REPOSITORY / 'src'}:{REPOSITORY}"},
            qemu=[
                *("-device", "piix3-usb-uhci,id=uhci", "-chardev", f"socket,path={socket},id=chip"),
                *("-device", "usb-redir,chardev=chip,bus=uhci.0"),
            ],
            timeout_s=400,
        )
    results = [json.loads(line) for line in ended.output.splitlines() if line.startswith('{"job"')]
    jobs = {result["job"]: result for result in results}
    return Guest(kernel, ended, jobs, [f"{register:02X}={value:02X}" for register, value in chip.written])
