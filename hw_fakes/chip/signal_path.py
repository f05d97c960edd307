"""What a moving chip's words hold: motion and imperfections through filter, range and converter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hw_fakes.chip import dlpf
from hw_fakes.chip.personalities import MPU6050, Personality
from hw_fakes.chip.samples import CountArray, Run
from hw_fakes.chip.setup import ACCEL_LSB_PER_G, GYRO_LSB_PER_DPS, Setup
from hw_fakes.world.drift import Drift
from hw_fakes.world.imperfections import Imperfections
from hw_fakes.world.motion import Motion
from quavelet.core.units import DEG_PER_RAD, NS_PER_S, STANDARD_GRAVITY_M_S2

FloatArray = NDArray[np.float64]

SETTLING_S = 0.010


class MotionSource:
    """The signal path of a chip in motion.

    What each sensor feels at each tick, its errors and white noise go through the low-pass filter, then are decimated,
    brought to the range, rounded and clipped. The gyroscope ticks at 1, 8 or 32 kHz, the accelerometer always at 1 kHz
    (RM register 25). The filter's past is that of the motion at the present setting: changing a setting, or self-test,
    shows no transient. Noise is a function of seed, run and chunk, so it does not depend on who reads when.

    A chip that wakes for single samples has no time to filter: a sample is one tick as it is, with the noise of all the
    500 Hz that a tick of 1 kHz has room for. The gyroscope is taken to be settled at once, which a real one is not.
    """

    def __init__(
        self,
        motion: Motion,
        imperfections: Imperfections,
        *,
        seed: int,
        birth_ns: int,
        accel_trim: tuple[int, int, int],
        self_test_codes: tuple[int, ...],
        personality: Personality = MPU6050,
    ) -> None:
        self.motion = motion
        self.imperfections = imperfections
        self.seed = seed
        self.birth_ns = birth_ns
        self.accel_trim = np.array(accel_trim) & ~1
        self.personality = personality
        self.self_test = personality.self_test_response(self_test_codes)
        rng, tau_s = np.random.default_rng((seed, 0, 0, 2)), imperfections.drift_correlation_s
        self.gyro_drift = Drift(rng, sd=imperfections.gyro_drift_rad_s, correlation_s=tau_s)
        self.accel_drift = Drift(rng, sd=imperfections.accel_drift_m_s2, correlation_s=tau_s)
        self._past: tuple[Run, int, FloatArray, FloatArray] | None = None

    def gyro_bias_rad_s(self, t_s: FloatArray) -> FloatArray:
        """The gyroscope's true bias (N, 3) at increasing times (N,) of the motion: zero, temperature and drift."""
        return self.imperfections.gyro_error_rad_s(t_s) + self.gyro_drift.at(t_s)

    def accel_bias_m_s2(self, t_s: FloatArray) -> FloatArray:
        """The accelerometer's true bias (N, 3) at increasing times (N,) of the motion."""
        bias: FloatArray = np.array(self.imperfections.accel_bias_m_s2) + self.accel_drift.at(t_s)
        return bias

    def limit(self, _run: Run, /) -> int | None:
        return None

    def fifo_begins(self, _run: Run, _sample: int, /) -> None:
        return

    def forget(self) -> None:
        self._past = None

    def words(self, run: Run, setup: Setup, chunk: int, /) -> CountArray:
        past_gyro, past_accel = self._felt_before(run, chunk)
        gyro, accel = self._felt(run, chunk)
        self._past = run, chunk, gyro, accel
        slow_by = run.nominal_hz // 1000
        gyro = _filtered(past_gyro, gyro, dlpf.taps(*setup.gyro_filter))
        accel = _filtered(past_accel, accel, dlpf.taps(*setup.accel_filter))
        at = np.arange(run.divider - 1, run.chunk * run.divider, run.divider)
        temp = self._temperature_degc(run, chunk, at)
        values = np.column_stack(
            [
                self._accel_lsb(accel[(at + 1) // slow_by], setup),
                (temp - self.personality.temp_zero_degc) * self.personality.temp_lsb_per_degc,  # RM registers 65 and 66
                self._gyro_lsb(gyro[at + 1], setup),
            ]
        )
        return np.clip(np.rint(values), -32768, 32767).astype(np.int16)

    def _times_s(self, run: Run, chunk: int, every: int) -> FloatArray:
        ticks = run.chunk * run.divider
        tick = np.arange(chunk * ticks + every, (chunk + 1) * ticks + 1, every)
        t_s: FloatArray = (run.start_ns - self.birth_ns + tick * run.tick_ns) / NS_PER_S
        return t_s

    def _random(self, run: Run, chunk: int, what: int) -> np.random.Generator:
        # The chunk before the first is number -1, and a seed's parts may not be negative.
        return np.random.default_rng((self.seed, run.number, chunk + 1, what))

    def _felt_before(self, run: Run, chunk: int) -> tuple[FloatArray, FloatArray]:
        if self._past is not None and self._past[:2] == (run, chunk - 1):
            return self._past[2:]
        return self._felt(run, chunk - 1)

    def _felt(self, run: Run, chunk: int) -> tuple[FloatArray, FloatArray]:
        """What the sensors give to the filter: rad/s at every tick of the chunk, m/s^2 at every tick of 1 kHz."""
        parts, rng = self.imperfections, self._random(run, chunk, 0)
        t_s = self._times_s(run, chunk, 1)
        force = self.motion.specific_force_m_s2(t_s) if parts.feels_force else None
        gyro = parts.gyro_shown_rad_s(self.motion.rate_rad_s(t_s), force) + self.gyro_bias_rad_s(t_s)
        if parts.gyro_settling_rad_s:
            awake_s = t_s - (run.awake_since_ns - self.birth_ns) / NS_PER_S
            gyro += parts.gyro_settling_rad_s * np.exp(-np.maximum(awake_s, 0.0) / SETTLING_S)[:, None]
        if parts.gyro_noise_rad_s_rthz:
            sd = parts.gyro_noise_rad_s_rthz * np.sqrt(run.nominal_hz / 2)
            gyro += sd * rng.standard_normal(gyro.shape)
        t_s = self._times_s(run, chunk, run.nominal_hz // 1000)
        accel = parts.accel_shown_m_s2(self.motion.specific_force_m_s2(t_s)) + self.accel_bias_m_s2(t_s)
        if parts.accel_noise_m_s2_rthz:
            accel += parts.accel_noise_m_s2_rthz * np.sqrt(1000 / 2) * rng.standard_normal(accel.shape)
        return gyro, accel

    def _temperature_degc(self, run: Run, chunk: int, at: NDArray[np.int64]) -> FloatArray:
        temp = self.imperfections.temperature_degc(self._times_s(run, chunk, 1)[at])
        if self.imperfections.temp_noise_degc:
            temp = temp + self.imperfections.temp_noise_degc * self._random(run, chunk, 1).standard_normal(len(at))
        return temp

    def _accel_lsb(self, accel_m_s2: FloatArray, setup: Setup) -> FloatArray:
        # The offset registers are 2048 LSB per g, and the factory's value stands for no offset.
        added_g = (np.array(setup.accel_offset) - self.accel_trim) / ACCEL_LSB_PER_G[3]
        for word in setup.self_test:
            if word < 3:
                added_g[word] += self.self_test[word] / ACCEL_LSB_PER_G[2]
        lsb: FloatArray = (accel_m_s2 / STANDARD_GRAVITY_M_S2 + added_g) * setup.accel_lsb_per_g
        return lsb

    def _gyro_lsb(self, gyro_rad_s: FloatArray, setup: Setup) -> FloatArray:
        added_dps = np.array(setup.gyro_offset) / GYRO_LSB_PER_DPS[2]
        for word in setup.self_test:
            if word > 3:
                added_dps[word - 4] += self.self_test[word - 1] / GYRO_LSB_PER_DPS[0]
        lsb: FloatArray = (gyro_rad_s * DEG_PER_RAD + added_dps) * setup.gyro_lsb_per_dps
        return lsb


def _filtered(past: FloatArray, now: FloatArray, response: FloatArray) -> FloatArray:
    """The filter's output for the last row of `past` and for all of `now`."""
    if len(response) > len(past):
        raise ValueError("a chunk is shorter than the filter's memory: compute more samples together")
    whole = np.concatenate([past[len(past) - len(response) :], now])
    return np.stack([np.convolve(axis, response, "valid") for axis in whole.T], 1)
