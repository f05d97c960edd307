"""The kernel of the fake under smbus2 and under what quavelet asks of the device beside it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from fcntl import F_GETFL, fcntl

from hw_fakes.ways.in_process import PatchedKernel
from hw_fakes.wire.adapter import Adapter


@contextmanager
def kernel_with(devices: Mapping[str, Adapter | int | None]) -> Iterator[PatchedKernel]:
    """What is opened inside the block must be closed at its end."""
    with PatchedKernel(devices, replace=["quavelet.bus.linux.ioctl"]).installed() as kernel:
        yield kernel
    assert not kernel.open_files, "left open"


def access_modes(kernel: PatchedKernel) -> set[int]:
    """How the files that are open were opened."""
    return {fcntl(fd, F_GETFL) & os.O_ACCMODE for fd in kernel.open_files}
