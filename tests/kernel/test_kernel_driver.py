"""Linux's own inv_mpu6050 driver on the fake, in a guest: it reads the truth, and it does not where there is none."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import pytest
from boot import Guest
from chips import STREAM_HZ, TEMP_DEGC, ramps
from guest_jobs import BURST, BURSTS, SINGLES
from report import SENSORS, mismatches, temperature_degc

from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

HERE = Path(__file__).resolve().parent

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


@pytest.mark.parametrize("job", ["driver_reads", "virtual_machine"])
def test_the_kernel_reads_another_truth(guest: Guest, job: str) -> None:
    """By USB/IP, where the chip is in the guest, and by usbredir, where it is outside."""
    read = guest.read(job)
    assert read["name"] == "mpu6050"
    assert mismatches(read) == []


def test_the_kernels_units_are_not_the_truths(guest: Guest) -> None:
    read = guest.read("driver_reads")
    for (sensor, _, truth), unit in zip(SENSORS, (STANDARD_GRAVITY_M_S2, RAD_PER_DEG), strict=True):
        for scale, raw in read[sensor].items():
            told = [count * float(scale) for count in raw]
            # Half a count, and a thousandth: the kernel takes 16.384 LSB a deg/s for the data sheet's 16.4.
            assert told == pytest.approx([unit * value for value in truth], abs=float(scale) / 2, rel=1.1e-3)


def test_the_kernel_reads_another_temperature(guest: Guest) -> None:
    assert temperature_degc(guest.read("driver_reads")) == pytest.approx(TEMP_DEGC, abs=1 / 340, rel=0)


def test_a_sampling_frequency_is_not_the_chips(guest: Guest) -> None:
    rates = guest.read("driver_reads")["rates"]
    assert len(rates) == 5
    for asked, (told, divider) in rates.items():
        assert (told, 1000 / (1 + divider)) == (asked, float(asked))


def test_a_gyroscope_with_half_its_scale_passes(guest: Guest) -> None:
    """The proof can fail: this is the check of the truth, on a chip that does not tell it."""
    scales = [f"anglvel at {scale}" for scale in guest.read("driver_reads")["anglvel"]]
    assert mismatches(guest.read("half_a_gyroscope")) == scales
    assert len(scales) == 4


def test_the_kernel_takes_a_chip_of_another_identity(guest: Guest) -> None:
    read = guest.read("another_identity")
    assert (read["driver"], read["iio"]) == (False, [])
    assert re.search(r"inv-mpu6050-i2c .* whoami .*0x61", guest.ended.console)


@pytest.mark.parametrize("what", ["probe", "stream"])
def test_the_kernel_writes_other_registers_than_it_did(guest: Guest, what: str) -> None:
    read = guest.read("driver_reads" if what == "probe" else "stream")
    assert without_suspending(read["trace"]) == golden(guest, what)


def test_the_chip_outside_the_guest_is_written_otherwise(guest: Guest) -> None:
    guest.read("virtual_machine")
    probe = golden(guest, "probe")
    assert without_suspending(guest.outside)[: len(probe)] == probe


def without_suspending(trace: list[str]) -> list[str]:
    """Of a probe: set up, the driver lets the chip sleep and wakes it by a worker, at no certain moment."""
    end = trace.index("37=00") if "37=00" in trace else len(trace)
    return trace[:end] + [write for write in trace[end:] if write not in ("6B=48", "6B=08")]


def golden(guest: Guest, what: str) -> list[str]:
    """The trace of this kernel's series, as 6.1."""
    series = ".".join(guest.kernel.release.split(".")[:2])
    path = HERE / f"{what}-linux-{series}.txt"
    if not path.exists():
        pytest.skip(f"there is no trace of Linux {series}: look at the one above and keep it as {path.name}")
    return [line for line in path.read_text().splitlines() if not line.startswith("#")]


def test_a_sample_is_lost_or_changed_on_its_way_through_fifo_and_interrupt(guest: Guest) -> None:
    read = guest.read("stream")
    samples = read["samples"]
    n = SINGLES + BURSTS * BURST
    assert [sample[:7] for sample in samples] == ramps(n).tolist()
    assert read["edges"] == n
    times = [sample[7] for sample in samples]
    steps = [after - before for before, after in pairwise(times)]
    assert min(steps) >= 1e9 / STREAM_HZ * 0.95


def test_samples_come_without_the_interrupt(guest: Guest) -> None:
    """The proof can fail: what is read came by the INT pin, or it did not come."""
    assert guest.read("stream")["unfired"] == 0
