"""The check-up of one board: each finding, and for each bad one the one thing to do next."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import numpy as np

from quavelet.bus.open import open_bus
from quavelet.calibration.calibrate import Calibrate
from quavelet.calibration.model import UNCALIBRATED
from quavelet.calibration.stillness import StillnessLimits
from quavelet.core.blocks import FloatArray, ImuBlock, RawBlock, concat
from quavelet.core.clock import Clock
from quavelet.core.health import Health
from quavelet.core.units import DEG_PER_RAD, NS_PER_S, STANDARD_GRAVITY_M_S2
from quavelet.mpu6050.config import GYRO_BANDWIDTH_HZ
from quavelet.mpu6050.source import ChipSource
from quavelet.settings import Settings

LISTEN_S = 5.0
DRAIN_S = 0.02
RATE_LIMIT = 0.02
"""PS 6.6: 1 % on the PLL; twice that is a chip running on something else."""
NOISE_LIMIT_DPS = 0.3
"""PS 6.1: 0.05 deg/s rms in 98 Hz; real boards lying still show up to three times that."""
BIAS_LIMIT_DPS = 20.0
"""PS 6.1: zero-rate output."""
GRAVITY_LIMIT_G = 0.12
"""PS 6.2: 80 mg of zero-g offset and 3 % of sensitivity."""


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """One thing looked at: what was found, and what to do when it is not ok."""

    name: str
    ok: bool
    found: str
    advice: str = ""


def check_up(settings: Settings, *, clock: Clock) -> Iterator[Finding]:
    """The findings, as they come. Raises what opening the bus or starting the chip raises."""
    health = Health()
    with open_bus(settings.bus.name, clock=clock) as bus:
        yield Finding(name="bus", ok=True, found=f"{bus.name} is open")
        source = ChipSource(bus, address=settings.bus.address, config=settings.chip, clock=clock, health=health)
        info = source.wait_until_streaming()
        yield Finding(
            name="chip", ok=True, found=f"0x{info.address:02x} is an {info.variant.name}, it was reset and woke"
        )
        yield _configuration(health)
        block = _listen(source, clock)
        if not len(block):
            yield Finding(
                name="samples",
                ok=False,
                found=f"none in {LISTEN_S:g} s",
                advice="power the board off and on; if that does not help, the chip is broken",
            )
            return
        decoder = source.decoder
        measured_hz = decoder.measured_rate_hz if decoder else None
        yield _rate(measured_hz, 1.0 / info.nominal_period_s)
        yield _losses(health)
        yield from _sensors(Calibrate(UNCALIBRATED).process(block), GYRO_BANDWIDTH_HZ[settings.chip.dlpf])


def _listen(source: ChipSource, clock: Clock) -> RawBlock:
    blocks = [source.read()]
    start_ns = clock.now_ns()
    for k in range(1, round(LISTEN_S / DRAIN_S) + 1):
        clock.sleep_until_ns(start_ns + round(k * DRAIN_S * NS_PER_S))
        blocks.append(source.read())
    return concat(blocks)


def _configuration(health: Health) -> Finding:
    bad = health.config_mismatches
    return Finding(
        name="registers",
        ok=bad == 0,
        found="hold what was written" if bad == 0 else f"{bad} times one did not hold what was written",
        advice="" if bad == 0 else "shorten the wires, check the supply voltage and the pull-ups",
    )


def _rate(measured_hz: float | None, nominal_hz: float) -> Finding:
    if measured_hz is None:
        return Finding(
            name="sample rate",
            ok=False,
            found="could not be measured",
            advice="the host is too busy to read the chip in time: stop other programs and try again",
        )
    error = measured_hz / nominal_hz - 1.0
    ok = abs(error) <= RATE_LIMIT
    return Finding(
        name="sample rate",
        ok=ok,
        found=f"{measured_hz:.2f} Hz, {100 * error:+.2f} % of {nominal_hz:g} Hz (measured, and corrected for)",
        advice="" if ok else "the chip does not run on its PLL: power it off and on, or replace it",
    )


def _losses(health: Health) -> Finding:
    ok = health.gaps == 0 and health.fifo_resets == 0
    return Finding(
        name="no sample lost",
        ok=ok,
        found=f"{health.samples} samples, {health.samples_lost} lost, {health.fifo_resets} FIFO resets, "
        f"{health.bus_errors} bus errors",
        advice="" if ok else "set dtparam=i2c_arm_baudrate=400000, shorten the wires, check the pull-ups",
    )


def _sensors(block: ImuBlock, bandwidth_hz: int) -> Iterator[Finding]:
    gyro_dps = DEG_PER_RAD * block.gyro_rad_s
    accel_g = block.accel_m_s2 / STANDARD_GRAVITY_M_S2
    limits = StillnessLimits()
    noise_dps, noise_g = gyro_dps.std(axis=0), accel_g.std(axis=0)
    still = bool(
        (noise_dps <= DEG_PER_RAD * limits.gyro_sd_rad_s).all()
        and (noise_g <= limits.accel_sd_m_s2 / STANDARD_GRAVITY_M_S2).all()
    )
    yield Finding(
        name="board still",
        ok=still,
        found="yes" if still else f"no, it turns or shakes by {float(noise_dps.max()):.1f} deg/s rms",
        advice="" if still else "lay it down, let go, and run this again: what follows was judged on a moving board",
    )
    alive = bool((noise_dps > 0).all() and (noise_g > 0).all())
    quiet = bool((noise_dps <= NOISE_LIMIT_DPS).all())
    yield Finding(
        name="gyroscope noise",
        ok=alive and quiet,
        found=f"{_three(noise_dps, 3)} deg/s rms in {bandwidth_hz} Hz (limit {NOISE_LIMIT_DPS:g}, data sheet 0.05)",
        advice=""
        if alive and quiet
        else ("an axis never changes: the chip is stuck, power it off and on" if not alive else "see 'board still'"),
    )
    bias = gyro_dps.mean(axis=0)
    ok = bool((np.abs(bias) <= BIAS_LIMIT_DPS).all())
    yield Finding(
        name="gyroscope bias",
        ok=ok,
        found=f"{_three(bias, 2)} deg/s (data sheet: within {BIAS_LIMIT_DPS:g}; removed at each still start)",
        advice="" if ok else "the board turns, or the chip is out of its data sheet: replace it",
    )
    gravity = float(np.linalg.norm(accel_g.mean(axis=0)))
    ok = abs(gravity - 1.0) <= GRAVITY_LIMIT_G
    yield Finding(
        name="gravity",
        ok=ok,
        found=f"{gravity:.4f} g",
        advice="" if ok else "0.5 or 2 g is early silicon or a clone with another scale; else an axis is broken",
    )
    temp = float(block.temp_degc.mean())
    ok = -40.0 <= temp <= 85.0
    yield Finding(
        name="temperature",
        ok=ok,
        found=f"{temp:.1f} degC in the chip",
        advice="" if ok else "the reading is outside what the chip survives: it is a clone with another formula",
    )


def _three(values: FloatArray, digits: int) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values.tolist())
