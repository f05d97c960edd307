"""Blocks for the tests of the fusion filters: a board that sways, with truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from quavelet.attitude import kernel
from quavelet.attitude.doubt import Residual
from quavelet.core.blocks import Flag, ImuBlock, array_fields

G = 9.80665
RESIDUAL = Residual(tilt_rad=0.001, gyro_bias_rad_s=np.radians(0.01), gyro_bias_rad_s_degc=0.0, gyro_scale=0.0)


def block(rates, forces, *, period_s: float = 0.01, flags: int = 0, still: bool = False) -> ImuBlock:
    rates, forces = np.asarray(rates, dtype=float), np.asarray(forces, dtype=float)
    n = len(rates)
    return ImuBlock(
        t_ns=np.round(np.arange(1, n + 1) * period_s * 1e9).astype(np.int64),
        period_s=np.full(n, period_s),
        gap_ns=np.zeros(n, dtype=np.int64),
        flags=np.full(n, flags, dtype=np.uint32),
        gyro_rad_s=rates,
        accel_m_s2=forces,
        temp_degc=np.full(n, 25.0),
        gyro_bias_rad_s=np.zeros((n, 3)),
        still=np.full(n, still),
    )


def level(n: int) -> np.ndarray:
    return np.tile([0.0, 0.0, G], (n, 1))


def with_gap(data: ImuBlock, start: int, end: int) -> ImuBlock:
    """The block without rows start to end, flagged and measured as the decoder does it."""
    keep = list(range(start)) + list(range(end, len(data)))
    cut = replace(data[keep], **{name: getattr(data, name)[keep].copy() for name in array_fields(type(data))})
    cut.gap_ns[start] = round((end - start) * data.period_s[0] * 1e9)
    cut.flags[start] |= Flag.GAP
    return cut


def swaying(seed: int, n: int, *, period_s: float = 0.01, bias=(0.0, 0.0, 0.0), hand_m_s: float = 0.0):
    """Rates (of the period that ends with the sample), forces and true attitudes (n, 4) of a board that rolls and
    pitches by tens of degrees, turns a little, and is pushed about with velocities of `hand_m_s`."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) * period_s
    phase = rng.uniform(0.0, 6.28, 3)
    rates = np.column_stack(
        [a * np.cos(w * t + p) for a, w, p in zip((0.5, 0.4, 0.2), (1.3, 0.9, 0.5), phase, strict=True)]
    )
    speed = hand_m_s * np.column_stack([np.sin(w * t + p) for w, p in zip((3.1, 4.3, 5.1), phase, strict=True)])
    push = np.gradient(speed, period_s, axis=0)
    q = kernel.standing((0.3, -0.5, G))
    truth, forces = np.empty((n, 4)), np.empty((n, 3))
    for k in range(n):
        q = truth[k] = kernel.step(q, tuple(rates[k]), period_s, "exp") if k else q
        q = tuple(q)
        w, x, y, z = q
        back = (w, -x, -y, -z)
        turned = kernel.product(kernel.product(back, (0.0, *(push[k] + [0.0, 0.0, G]))), q)
        forces[k] = turned[1:]
    rates = rates + np.radians(bias) + rng.normal(0.0, np.radians(0.05), (n, 3))
    return rates, forces + rng.normal(0.0, 0.03, (n, 3)), truth
