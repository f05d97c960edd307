"""What each kind of denoising does and costs: `python tests/denoise/denoise_figures.py` prints the README's tables.

Rates in deg/s at 100 samples a second, white noise of 0.0354 deg/s (data sheet), as the papers' corrected forms
are measured; the error is that of a sample against its own truth, so a delay is none.
"""

from __future__ import annotations

import time

import numpy as np

from quavelet.attitude.doubt import Residual
from quavelet.attitude.pid import PidFilter, PidParams
from quavelet.core.blocks import FloatArray, ImuBlock, concat
from quavelet.denoise.params import DenoiseParams
from quavelet.denoise.stage import Denoise

KINDS = {
    "none": DenoiseParams(),
    "hampel": DenoiseParams(kind="hampel"),
    "median": DenoiseParams(kind="median"),
    "smoother": DenoiseParams(kind="smoother"),
    "lowpass": DenoiseParams(kind="lowpass"),
    "wavelet": DenoiseParams(kind="wavelet"),
    "wavelet, improved": DenoiseParams(kind="wavelet", shrink="improved"),
    "wavelet, db4 x 5": DenoiseParams(kind="wavelet", wavelet="db4", levels=5),
    "median of 13": DenoiseParams(kind="median", window=13),
}
RATE_HZ, NOISE_DPS, ACCEL_NOISE_G = 100.0, 0.0354, 2.83e-3
N = 12000


def block_of(rate_dps: FloatArray, roll_rad: FloatArray, seed: int) -> ImuBlock:
    """A board that rolls about x at this rate (N,), measured with the data sheet's noise."""
    n, rng = len(rate_dps), np.random.default_rng(seed)
    gyro = np.column_stack([rate_dps, np.zeros((n, 2))]) + NOISE_DPS * rng.normal(size=(n, 3))
    up = np.column_stack([np.zeros(n), np.sin(roll_rad), np.cos(roll_rad)])
    return ImuBlock(
        t_ns=np.arange(1, n + 1) * 10_000_000,
        period_s=np.full(n, 1 / RATE_HZ),
        gap_ns=np.zeros(n, dtype=np.int64),
        flags=np.zeros(n, dtype=np.uint32),
        gyro_rad_s=np.radians(gyro),
        accel_m_s2=9.80665 * (up + ACCEL_NOISE_G * rng.normal(size=(n, 3))),
        temp_degc=np.full(n, 25.0),
        gyro_bias_rad_s=np.zeros((n, 3)),
        still=np.zeros(n, dtype=np.bool_),
    )


def swinging(hz: float, peak_dps: float, seed: int) -> tuple[ImuBlock, FloatArray, FloatArray]:
    """A board that swings about x; with its true rate in deg/s and its true roll in rad."""
    t = np.arange(1, N + 1) / RATE_HZ
    w = 2 * np.pi * max(hz, 1e-9)
    rate, roll = peak_dps * np.sin(w * t), np.radians(peak_dps) * (1 - np.cos(w * t)) / w
    return block_of(rate, roll, seed), rate, roll


def through(params: DenoiseParams, block: ImuBlock) -> ImuBlock:
    """All rows, the last ones too."""
    row_filter = params.build()
    if row_filter is None:
        return block
    stage = Denoise(row_filter, sample_rate_hz=RATE_HZ)
    return concat([stage.process(block), stage.finish()])


def rate_error(params: DenoiseParams, *, hz: float, peak_dps: float) -> float:
    """RMS error of the rate about the swinging axis, over the sigma of the noise."""
    block, rate, _ = swinging(hz, peak_dps, 3)
    error = np.degrees(through(params, block).gyro_rad_s[:, 0]) - rate
    return float(np.std(error[500:]) / NOISE_DPS)


def spikes_left(params: DenoiseParams) -> float:
    """RMS error at rest with 0.2 % spikes of 8 deg/s (paper 003), over the noise's sigma."""
    rng = np.random.default_rng(5)
    block, _, _ = swinging(0.0, 0.0, 5)
    spikes = np.where(rng.random((N, 3)) < 0.002, rng.normal(size=(N, 3)) * 8.0, 0.0)
    spoilt = ImuBlock(**{name: getattr(block, name) for name in ImuBlock.__dataclass_fields__})
    spoilt.gyro_rad_s[:] += np.radians(spikes)
    return float(np.degrees(through(params, spoilt).gyro_rad_s[500:]).std() / NOISE_DPS)


def tilt_error(params: DenoiseParams, *, hz: float, peak_dps: float) -> float:
    """RMS error of roll in degrees after the PID filter with kp = 1."""
    block, _, roll = swinging(hz, peak_dps, 4)
    block = through(params, block)
    residual = Residual(tilt_rad=0.0, gyro_bias_rad_s=0.0, gyro_bias_rad_s_degc=0.0, gyro_scale=0.0)
    q = PidFilter(PidParams(kp=1.0, ki=0.0), residual=residual).process(block).q
    got = np.arctan2(2 * (q[:, 0] * q[:, 1] + q[:, 2] * q[:, 3]), 1 - 2 * (q[:, 1] ** 2 + q[:, 2] ** 2))
    return float(np.degrees(np.sqrt(np.mean((got - roll)[2000:] ** 2))))


def us_per_sample(params: DenoiseParams, rows: int) -> float:
    """Microseconds of processor time for a sample of six axes, in blocks of so many rows; the best of five goes."""
    block, _, _ = swinging(0.5, 20.0, 6)
    best = float("inf")
    for _ in range(5):
        row_filter = params.build()
        assert row_filter is not None
        stage = Denoise(row_filter, sample_rate_hz=RATE_HZ)
        taken = min(N, 200 * rows)
        begun = time.thread_time()
        for start in range(0, taken, rows):
            stage.process(block[start : start + rows])
        best = min(best, (time.thread_time() - begun) / taken * 1e6)
    return best


def effect_rows() -> list[str]:
    """The rows of the README's first table: what it does, which the tests hold it to."""
    rows = []
    for name, params in KINDS.items():
        row_filter = params.build()
        delay = row_filter.delay if row_filter else 0
        ms = " / ".join(f"{delay * 1000 / hz:g}" for hz in (100, 200, 1000))
        errors = [rate_error(params, hz=hz, peak_dps=peak) for hz, peak in ((0.0, 0.0), (0.5, 20.0), (5.0, 20.0))]
        figures = [f"{x:.2f}" for x in (*errors, spikes_left(params))]
        rows.append(f"| {name} | {delay} | {ms} | {' | '.join(figures)} |")
    return rows


def tilt_rows() -> list[str]:
    """The rows of the second table: tilt in thousandths of a degree, at rest and swinging."""
    rows = []
    for name, params in KINDS.items():
        errors = [tilt_error(params, hz=hz, peak_dps=peak) for hz, peak in ((0.0, 0.0), (0.5, 20.0), (5.0, 20.0))]
        rows.append(f"| {name} | {' | '.join(f'{1000 * x:.1f}' for x in errors)} |")
    return rows


def main() -> None:
    print("\n".join(effect_rows()))
    print()
    print("\n".join(tilt_rows()))
    print()
    for name, params in KINDS.items():
        if params.kind != "none":
            times = [f"{us_per_sample(params, rows):.0f}" for rows in (1, 2, 10, N)]
            print(f"| {name} | {' | '.join(times)} |")


if __name__ == "__main__":
    main()
