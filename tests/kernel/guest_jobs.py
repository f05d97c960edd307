"""What is done in the guest, as root: each job prints one line of JSON with what it read. It judges nothing.

python guest_jobs.py INTERRUPT_MODULE [JOB ...]
"""

from __future__ import annotations

import json
import os
import select
import struct
import subprocess
import sys
import sysconfig
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from chips import ADDRESS, STREAM_HZ, ramp_chip, steady_chip

from hw_fakes import FakeMpu6050
from hw_fakes.ways.usb_ip import attached_usbip
from hw_fakes.wire.adapter import Adapter
from quavelet.core.clock import MonotonicClock
from quavelet.core.units import NS_PER_S

I2C = Path("/sys/bus/i2c/devices")
AXES = "xyz"
SAMPLE = struct.Struct(">7h2x")  # in_accel, in_temp and in_anglvel, each be:s16/16>>0, then a timestamp on 8 bytes
TIMESTAMP = struct.Struct("<q")
SAMPLES_S = 0.05  # the kernel sets 50 Hz, and does not wait for the first sample at another scale
SINGLES, BURSTS, BURST = 150, 50, 5  # samples one by one, then five at each interrupt, as when that is served late


class HeldClock:
    """The host's clock until it is held, from then on it moves only as told."""

    def __init__(self) -> None:
        self._held_ns: int | None = None

    def now_ns(self) -> int:
        return time.monotonic_ns() if self._held_ns is None else self._held_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        raise NotImplementedError("nobody sleeps in the guest by this clock")

    def hold(self) -> None:
        self._held_ns = self.now_ns()

    def advance_ns(self, dt_ns: int) -> None:
        self._held_ns = self.now_ns() + dt_ns


def driver_reads(_: Path) -> dict[str, Any]:
    """The kernel's driver on a chip without errors: all it can be asked for one by one."""
    chip = steady_chip(MonotonicClock())
    with attached_usbip(Adapter({ADDRESS: chip})) as number, bound(number) as iio:
        trace = [f"{register:02X}={value:02X}" for register, value in chip.written]
        read = {"name": text(iio / "name"), "trace": trace, **all_scales(iio)}
        read["temperature"] = {key: text(iio / f"in_temp_{key}") for key in ("raw", "offset", "scale")}
        read["rates"] = {}
        for hz in ("10", "50", "200", "500", "1000"):
            (iio / "sampling_frequency").write_text(hz)
            read["rates"][hz] = [text(iio / "sampling_frequency"), chip.registers[0x19]]
        return read


def half_a_gyroscope(_: Path) -> dict[str, Any]:
    """The same on a chip that shows half of every rate."""
    chip = steady_chip(MonotonicClock(), gyro_scale=0.5)
    with attached_usbip(Adapter({ADDRESS: chip})) as number, bound(number) as iio:
        return all_scales(iio)


def another_identity(_: Path) -> dict[str, Any]:
    """A chip whose WHO_AM_I is that of none the driver knows."""
    chip = steady_chip(MonotonicClock(), who_am_i=0x61)
    with attached_usbip(Adapter({ADDRESS: chip})) as number:
        (I2C / f"i2c-{number}/new_device").write_text(f"mpu6050 0x{ADDRESS:02x}")
        client = I2C / f"{number}-00{ADDRESS:02x}"
        return {"driver": (client / "driver").exists(), "iio": [path.name for path in client.glob("iio:*")]}


def stream(module: Path) -> dict[str, Any]:
    """Every sample through the FIFO and an interrupt that follows the chip's own INT pin, in time that is held."""
    clock = HeldClock()
    bursts = [1] * SINGLES + [BURST] * BURSTS
    chip = ramp_chip(clock, sum(bursts) + 1)
    edges, samples = 0, []
    with attached_usbip(Adapter({ADDRESS: chip})) as number, with_interrupt(module, number) as iio:
        (iio / "sampling_frequency").write_text(str(STREAM_HZ))
        for element in sorted((iio / "scan_elements").glob("*_en")):
            element.write_text("1")
        layout = {path.name: text(path) for path in sorted((iio / "scan_elements").glob("*_type"))}
        until(lambda: text(iio.parent / "power/runtime_status") == "suspended")
        clock.hold()
        before = len(chip.written)
        (iio / "buffer/enable").write_text("1")
        trace = [f"{register:02X}={value:02X}" for register, value in chip.written[before:]]
        device = os.open(f"/dev/{iio.name}", os.O_RDONLY | os.O_NONBLOCK)
        try:
            for burst in bursts:
                pulses = let_pass(chip, clock, samples=burst)
                edges += pulses
                if pulses:
                    fire()
                arrived = received(device, burst, wait_s=10.0)
                samples += arrived
                if len(arrived) < burst:
                    break
            let_pass(chip, clock, samples=1)
            unfired = len(received(device, 1, wait_s=0.5))
        finally:
            os.close(device)
            (iio / "buffer/enable").write_text("0")
    return {"layout": layout, "trace": trace, "edges": edges, "samples": samples, "unfired": unfired}


def let_pass(chip: FakeMpu6050, clock: HeldClock, *, samples: int) -> int:
    """The time of so many samples; the pulses of the INT pin in it."""
    since_ns = clock.now_ns()
    clock.advance_ns(samples * NS_PER_S // STREAM_HZ)
    # The kernel tells the times of late samples by the nominal rate: real time must not go slower than that.
    time.sleep(2 * samples / STREAM_HZ)
    return sum(edge.high for edge in chip.int_edges(since_ns + 1))


def fire() -> None:
    Path("/sys/module/hw_fakes_irq/parameters/fire").write_text("1")


def received(device: int, n: int, *, wait_s: float) -> list[list[int]]:
    """The next n samples, or as many as come in time: the seven words and the timestamp of each."""
    samples: list[list[int]] = []
    size = SAMPLE.size + TIMESTAMP.size
    poll = select.poll()
    poll.register(device, select.POLLIN)
    deadline = time.monotonic() + wait_s
    while len(samples) < n and (left_s := deadline - time.monotonic()) > 0:
        if poll.poll(1000 * left_s):
            data = os.read(device, size * (n - len(samples)))
            for at in range(0, len(data), size):
                words = SAMPLE.unpack_from(data, at)
                samples.append([*words, *TIMESTAMP.unpack_from(data, at + SAMPLE.size)])
    return samples


def i2c_tools(_: Path) -> dict[str, Any]:
    """Debian's i2c-tools on the kernel's own /dev/i2c-N."""
    chip = steady_chip(MonotonicClock())
    with attached_usbip(Adapter({ADDRESS: chip})) as number:
        n = str(number)
        return {
            "number": number,
            "list": ran("i2cdetect", "-l"),
            "functions": ran("i2cdetect", "-F", n),
            "quick": ran("i2cdetect", "-y", "-q", n),
            "wake": ran("i2cset", "-y", n, "0x68", "0x6b", "1"),
            "block": ran("i2cset", "-y", n, "0x68", "0x19", "9", "2", "0x18", "0x10", "i"),
            "identity": ran("i2cget", "-y", n, "0x68", "0x75"),
            "word": ran("i2cget", "-y", n, "0x68", "0x19", "w"),
            "transfer": ran("i2ctransfer", "-y", n, "w1@0x68", "0x19", "r4"),
            "nobody": ran("i2ctransfer", "-y", n, "r1@0x50"),
            "fifo": ran("i2ctransfer", "-y", n, "w1@0x68", "0x74", "r1024"),
        }


def quavelet(_: Path) -> dict[str, Any]:
    """The project's own program on the kernel's /dev/i2c-N, by the command that plugs the fake in."""
    serve = (sys.executable, "-m", "hw_fakes", "serve", "--scenario", "still", "--as", "usbip", "--", "sh", "-c")
    program = Path(sysconfig.get_path("scripts"), "quavelet")
    return {"doctor": ran(*serve, f"exec {program} doctor --bus linux:$HW_FAKES_I2C_BUS --json")}


def virtual_machine(_: Path) -> dict[str, Any]:
    """The adapter that QEMU plugged in, with the chip outside of the guest."""
    (number,) = [int(path.name.removeprefix("i2c-")) for path in I2C.glob("i2c-*")]
    with bound(number) as iio:
        return {"name": text(iio / "name"), **all_scales(iio)}


JOBS: dict[str, Callable[[Path], dict[str, Any]]] = {
    job.__name__: job
    for job in (virtual_machine, driver_reads, half_a_gyroscope, another_identity, stream, i2c_tools, quavelet)
}


@contextmanager
def bound(number: int) -> Iterator[Path]:
    """The IIO device that the kernel's driver makes of the chip on adapter `number`."""
    adapter = I2C / f"i2c-{number}"
    (adapter / "new_device").write_text(f"mpu6050 0x{ADDRESS:02x}")
    try:
        (iio,) = (I2C / f"{number}-00{ADDRESS:02x}").glob("iio:device*")
        yield iio
    finally:
        (adapter / "delete_device").write_text(f"0x{ADDRESS:02x}")


@contextmanager
def with_interrupt(module: Path, number: int) -> Iterator[Path]:
    """As `bound`, with an interrupt that `fire` fires."""
    subprocess.run(["insmod", module, f"bus={number}", f"address={ADDRESS}", "kind=mpu6050"], check=True)
    try:
        (iio,) = (I2C / f"{number}-00{ADDRESS:02x}").glob("iio:device*")
        yield iio
    finally:
        subprocess.run(["rmmod", module.stem.split("-")[0]], check=True)


def all_scales(iio: Path) -> dict[str, Any]:
    """By sensor and scale: the three raw values at it."""
    read: dict[str, Any] = {}
    for sensor in ("accel", "anglvel"):
        read[sensor] = {}
        for scale in text(iio / f"in_{sensor}_scale_available").split():
            (iio / f"in_{sensor}_scale").write_text(scale)
            time.sleep(SAMPLES_S)
            read[sensor][text(iio / f"in_{sensor}_scale")] = [int(text(iio / f"in_{sensor}_{a}_raw")) for a in AXES]
    return read


def until(true: Callable[[], bool], *, wait_s: float = 20.0) -> None:
    deadline = time.monotonic() + wait_s
    while not true():
        if time.monotonic() > deadline:
            raise TimeoutError
        time.sleep(0.05)


def text(path: Path) -> str:
    return path.read_text().strip()


def ran(*command: str) -> list[Any]:
    """Exit code, stdout, stderr."""
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    return [done.returncode, done.stdout, done.stderr]


def main() -> None:
    module, *asked = sys.argv[1:]
    for name in asked or JOBS:
        began = time.monotonic()
        try:
            result = JOBS[name](Path(module))
        except Exception:  # noqa: BLE001  the other jobs are to be done as well
            result = {"error": traceback.format_exc()}
        print(json.dumps({"job": name, "seconds": time.monotonic() - began, **result}), flush=True)


if __name__ == "__main__":
    main()
