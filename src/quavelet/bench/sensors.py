"""What five seconds of samples of a board that lies still say about its sensors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from quavelet.bench.finding import Finding
from quavelet.calibration.stillness import StillnessLimits
from quavelet.core.blocks import Flag, FloatArray, ImuBlock
from quavelet.core.units import DEG_PER_RAD, STANDARD_GRAVITY_M_S2
from quavelet.mpu6050.config import ACCEL_LSB_PER_G, GYRO_BANDWIDTH_HZ, GYRO_LSB_PER_DPS, ChipConfig

ACCEL_BANDWIDTH_HZ = (260, 184, 94, 44, 21, 10, 5)
"""By DLPF_CFG (RM p. 13)."""
GYRO_DENSITY_DPS_RTHZ = 0.005
"""PS 6.1."""
ACCEL_DENSITY_UG_RTHZ = 400.0
"""PS 6.2."""
NOISY, BROKEN = 3.0, 8.0
"""Times the data sheet's noise. Real boards that lie still show up to three times."""
GYRO_BIAS_LIMIT_DPS = 20.0
"""PS 6.1: zero-rate output."""
GRAVITY_LIMIT_G = 0.12
"""PS 6.2: 80 mg of zero-g offset and 3 % of sensitivity."""
WARM_DEGC = 45.0
AXES = "xyz"
STILL, ALIVE = "board still", "axes alive"
"""The findings without which nothing can be said of noise, bias, gravity and self-test."""


@dataclass(frozen=True, slots=True)
class _Sensor:
    """One of the two sensors: its noise by the data sheet, its filter, and one count, in `unit` and `unit`/rtHz."""

    name: str
    unit: str
    key: str
    density: float
    bandwidth_hz: int
    lsb: float

    @property
    def sd(self) -> float:
        """What the data sheet's noise comes to in one sample."""
        return self.density * sqrt(self.bandwidth_hz)

    @property
    def hidden(self) -> bool:
        """A count is so wide that a good sensor may show the same one all the time."""
        return self.sd < self.lsb / 2


def sensors(block: ImuBlock, config: ChipConfig) -> Iterator[Finding]:
    """The findings, one after the other; on a board that moves or is frozen, noise, bias and gravity are not judged."""
    gyro_dps = DEG_PER_RAD * block.gyro_rad_s
    accel_ug = 1e6 * block.accel_m_s2 / STANDARD_GRAVITY_M_S2
    rate_hz = 1.0 / float(block.period_s[-1])
    gyro_sd, accel_sd = _noise(gyro_dps, rate_hz), _noise(accel_ug, rate_hz)
    gyro = _Sensor(
        "gyroscope",
        "deg/s",
        "dps_rthz",
        GYRO_DENSITY_DPS_RTHZ,
        GYRO_BANDWIDTH_HZ[config.dlpf],
        1.0 / GYRO_LSB_PER_DPS[config.gyro_range_dps],
    )
    accel = _Sensor(
        "accelerometer",
        "ug",
        "ug_rthz",
        ACCEL_DENSITY_UG_RTHZ,
        ACCEL_BANDWIDTH_HZ[config.dlpf],
        1e6 / ACCEL_LSB_PER_G[config.accel_range_g],
    )
    still, alive = _stillness(gyro_sd, accel_sd), _alive(block, ((gyro, gyro_dps), (accel, accel_ug)))
    yield still
    yield alive
    if still.ok and alive.ok:
        yield _density(gyro, gyro_sd)
        yield _density(accel, accel_sd)
        yield _bias(gyro_dps.mean(axis=0))
        yield _gravity(1e-6 * accel_ug.mean(axis=0))
    yield _temperature(float(block.temp_degc.mean()))


def _noise(values: FloatArray, rate_hz: float) -> FloatArray:
    """Standard deviation (3,) about the mean of each second, so that warming up is not taken for noise."""
    n = max(2, round(rate_hz))
    seconds = [values[k : k + n] for k in range(0, max(1, len(values) - n + 1), n)]
    sd: FloatArray = np.sqrt(np.mean([second.var(axis=0) for second in seconds], axis=0))
    return sd


def _stillness(gyro_sd_dps: FloatArray, accel_sd_ug: FloatArray) -> Finding:
    limits = StillnessLimits()
    accel_sd_g, accel_limit_g = 1e-6 * accel_sd_ug, limits.accel_sd_m_s2 / STANDARD_GRAVITY_M_S2
    if (gyro_sd_dps <= DEG_PER_RAD * limits.gyro_sd_rad_s).all() and (accel_sd_g <= accel_limit_g).all():
        return Finding(name=STILL, ok=True, found="yes")
    return Finding(
        name=STILL,
        ok=False,
        found=f"no, it turns by {gyro_sd_dps.max():.1f} deg/s rms and shakes by {accel_sd_g.max():.2f} g rms",
        advice="lay it down, let go, and run this again: noise, bias and gravity show on a still board only; if it "
        "does lie still, its sensors are broken",
    )


def _alive(block: ImuBlock, shown: Sequence[tuple[_Sensor, FloatArray]]) -> Finding:
    # Of alike numbers the standard deviation is not always 0.
    changing = [(sensor, np.ptp(values, axis=0) > 0) for sensor, values in shown]
    if not any(changes.any() for _, changes in changing) or (block.flags & np.uint32(Flag.STUCK)).any():
        return Finding(
            name=ALIVE,
            ok=False,
            found="no axis changes: the chip is frozen, real sensors have noise",
            advice="power the board off and on; if that does not help, the chip is broken",
        )
    dead = [
        f"{sensor.name} {AXES[k]}"
        for sensor, changes in changing
        for k in range(3)
        if not (changes[k] or sensor.hidden)
    ]
    if dead:
        return Finding(
            name=ALIVE,
            ok=False,
            found=f"{', '.join(dead)} never changed",
            advice="power the board off and on; if that does not help, the chip is broken",
        )
    return Finding(name=ALIVE, ok=True, found="they change, as sensors with noise do")


def _density(sensor: _Sensor, sd: FloatArray) -> Finding:
    """Noise as a density over the filter's bandwidth; rounding to whole counts is no noise of the sensor."""
    name, over = f"{sensor.name} noise", f"{sensor.unit}/rtHz over {sensor.bandwidth_hz} Hz"
    density = np.sqrt(np.maximum(sd**2 - sensor.lsb**2 / 12, 0.0)) / sqrt(sensor.bandwidth_hz)
    noisy = [AXES[k] for k in range(3) if density[k] > NOISY * sensor.density]
    if sensor.hidden and not noisy:
        return Finding(name=name, ok=True, found=f"less than one count shows, {sensor.lsb:.2g} {sensor.unit}")
    return Finding(
        name=name,
        ok=bool((density <= BROKEN * sensor.density).all()),
        found=f"{_three(density, 4 if sensor.density < 1 else 0)} {over} (data sheet {sensor.density:g})",
        advice=f"more than {NOISY:g} times the data sheet's noise on {', '.join(noisy)}: fasten the board, take it off "
        f"motors and fans, and give it a clean 3.3 V"
        if noisy
        else "",
        figures={
            f"{axis}_{sensor.key}": float(f"{value:.4g}") for axis, value in zip(AXES, density.tolist(), strict=True)
        },
    )


def _bias(bias_dps: FloatArray) -> Finding:
    ok = bool((np.abs(bias_dps) <= GYRO_BIAS_LIMIT_DPS).all())
    return Finding(
        name="gyroscope bias",
        ok=ok,
        found=f"{_three(bias_dps, 2)} deg/s (data sheet: within {GYRO_BIAS_LIMIT_DPS:g}; removed at each still start)",
        advice="" if ok else "the board turns evenly, or the chip is out of its data sheet: replace it",
        figures={f"{axis}_dps": round(value, 4) for axis, value in zip(AXES, bias_dps.tolist(), strict=True)},
    )


def _gravity(mean_g: FloatArray) -> Finding:
    gravity = float(np.linalg.norm(mean_g))
    ok = abs(gravity - 1.0) <= GRAVITY_LIMIT_G
    k = int(np.abs(mean_g).argmax())
    found = f"{gravity:.3f} g"
    advice = ""
    if ok:
        found += f", {'+' if mean_g[k] > 0 else '-'}{AXES[k]} is up"
    elif abs(gravity - 0.5) <= GRAVITY_LIMIT_G / 2:
        found += ", half of what it should be"
        advice = "a clone that counts half as many per g: angles are right, forces are half; replace it"
    elif abs(gravity - 2.0) <= 2 * GRAVITY_LIMIT_G:
        found += ", twice what it should be"
        advice = "a clone that counts twice as many per g: angles are right, forces are double; replace it"
    else:
        advice = "an axis of the accelerometer is broken: replace the board"
    figures = {"gravity_g": round(gravity, 4)}
    return Finding(name="gravity", ok=ok, found=found, advice=advice, figures=figures)


def _temperature(temp_degc: float) -> Finding:
    ok = -40.0 <= temp_degc <= 85.0
    advice = (
        "" if ok else "the chip does not survive that: it is a clone with another formula, do not use its temperature"
    )
    if ok and temp_degc > WARM_DEGC:
        advice = "a hot place, or a clone with another formula: compare with a thermometer"
    return Finding(
        name="temperature",
        ok=ok,
        found=f"{temp_degc:.1f} degC in the chip",
        advice=advice,
        figures={"temp_degc": round(temp_degc, 2)},
    )


def _three(values: FloatArray, digits: int) -> str:
    # With 0.0 added there is no minus before a zero.
    return " ".join(f"{round(value, digits) + 0.0:.{digits}f}" for value in values.tolist())
