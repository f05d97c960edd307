"""Where up was in a hand recording, by one fit over all of it: an oracle that shares nothing with any filter.

Over half a minute of hand motion the accelerations average out, and a gyroscope whose bias is known drifts by less than
a degree. So all samples together say where the board stood at the beginning (2 numbers) and what the gyroscope's bias
(3) and matrix (9) are, and the rates turned from there say where up was at each sample. The accelerometer's offset and
scale come from the still moments of all recordings, by the size of gravity.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

STILL_S, STILL_G, STILL_DPS = 0.4, 0.02, 12.0
PRIOR = np.concatenate([np.full(2, 0.2), np.full(3, np.radians(0.05)), np.where(np.eye(3).ravel() > 0, 0.0173, 0.0115)])
"""One sigma: first tilt in rad, bias once the still file's is off in rad/s, matrix by the data sheet."""
HAND_SIGMA, HAND_S = 0.035, 0.5
"""Of the direction of a hand's accelerations, in units of g, and for how long they last."""


@dataclass(frozen=True)
class Hand:
    """A recording: rate in rad/s without bias, force in g as shown and corrected, and where a rate was at its end."""

    name: str
    rate_hz: float
    gyro_rad_s: np.ndarray
    shown_g: np.ndarray
    force_g: np.ndarray
    clipped: np.ndarray


def read(file: Path, *, bias_dps: tuple[float, ...], offset_g: np.ndarray, scale: np.ndarray) -> Hand:
    data = np.load(file)
    counts, shown = data["gyr"].astype(int), data["acc"] / 4096.0
    rates = np.radians(counts / 131.0 - bias_dps)
    clipped = (np.abs(counts) >= 32767).any(axis=1)
    return Hand(
        file.stem.removeprefix("sunsided_"), float(data["rate"]), rates, shown, (shown - offset_g) * scale, clipped
    )


def accelerometer_of(files: list[Path], *, bias_dps: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Offset in g and scale (3,) each by which gravity has one size in all still moments."""
    means = []
    for file in files:
        data = np.load(file)
        forces, rates = data["acc"] / 4096.0, np.abs(data["gyr"] / 131.0 - bias_dps)
        n = int(STILL_S * float(data["rate"]))
        for k in range(0, len(forces) - n, n // 2):
            part = forces[k : k + n]
            if part.std(axis=0).max() < STILL_G and rates[k : k + n].max() < STILL_DPS:
                means.append(part.mean(axis=0))
    means = np.array(means)
    fit = least_squares(
        lambda x: np.linalg.norm((means - x[:3]) * x[3:], axis=1) - 1.0,
        [0.0, 0.0, 0.0, 1.0, 1.0, 1.0],
        loss="soft_l1",
        f_scale=0.01,
    )
    return fit.x[:3], fit.x[3:]


def up_of(hand: Hand) -> np.ndarray:
    """Up in the body (N, 3) at the end of each sample; nan where nothing can be said after a clipped rate."""
    up = np.full_like(hand.force_g, np.nan)
    bounds = [0, *(np.flatnonzero(hand.clipped) + 1).tolist(), len(up)]
    for begin, end in pairwise(bounds):
        if end - begin > 5.0 * hand.rate_hz:
            up[begin:end] = _fitted(hand.gyro_rad_s[begin:end], hand.force_g[begin:end], hand.rate_hz)
    return up


def _fitted(rates: np.ndarray, forces: np.ndarray, rate_hz: float) -> np.ndarray:
    sizes = np.linalg.norm(forces, axis=1)
    seen, near = forces / sizes[:, None], np.abs(sizes - 1.0) < 0.1
    first = seen[:30].mean(axis=0) / np.linalg.norm(seen[:30].mean(axis=0))
    across = np.linalg.svd(first[None])[2][1:]
    x, steps = np.zeros(len(PRIOR)), 1e-3 * PRIOR
    for _ in range(20):
        tried = x + np.vstack([np.zeros(len(x)), np.diag(steps)])
        up = _turned(first + tried[:, :2] @ across, rates, tried, 1.0 / rate_hz)
        left = (seen - up[:, 0])[near]
        slopes = (up[:, 1:] - up[:, :1])[near] / steps[:, None]
        weight = 1.0 / (1.0 + (left**2).sum(axis=1) / 0.05**2) / (HAND_SIGMA**2 * rate_hz * HAND_S)
        normal = np.einsum("kpi,kqi,k->pq", slopes, slopes, weight) + np.diag(PRIOR**-2)
        change = np.linalg.solve(normal, np.einsum("kpi,ki,k->p", slopes, left, weight) - x / PRIOR**2)
        x = x + change
        if (np.abs(change) < 0.02 * PRIOR).all():
            return up[:, 0]
    raise AssertionError("the fit does not converge")


def _turned(first: np.ndarray, rates: np.ndarray, tried: np.ndarray, period_s: float) -> np.ndarray:
    """Up (N, M, 3) for M sets of numbers: du/dt = -w x u, exactly for a rate that is constant over each sample."""
    matrix = np.eye(3) + tried[:, 5:].reshape(-1, 3, 3)
    turns = -period_s * np.einsum("mij,kmj->kmi", matrix, rates[:, None] - tried[None, :, 2:5])
    angle = np.linalg.norm(turns, axis=2, keepdims=True)
    x, y, z = np.moveaxis(turns / np.maximum(angle, 1e-12), 2, 0)
    c, s = np.cos(angle[..., 0]), np.sin(angle[..., 0])
    d = 1.0 - c
    rotation = np.stack(
        [
            np.stack([c + x * x * d, x * y * d - z * s, x * z * d + y * s], axis=-1),
            np.stack([x * y * d + z * s, c + y * y * d, y * z * d - x * s], axis=-1),
            np.stack([x * z * d - y * s, y * z * d + x * s, c + z * z * d], axis=-1),
        ],
        axis=-2,
    )
    up, all_up = first / np.linalg.norm(first, axis=1, keepdims=True), np.empty((len(rates), *first.shape))
    for k, turn in enumerate(rotation):
        up = np.matmul(turn, up[..., None])[..., 0]
        all_up[k] = up
    return all_up
