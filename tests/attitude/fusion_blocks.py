"""Blocks for the tests of the fusion filters: a board that sways, with truth."""

from __future__ import annotations

import numpy as np

from quavelet.attitude import kernel
from quavelet.attitude.doubt import Residual

G = 9.80665
RESIDUAL = Residual(tilt_rad=0.001, gyro_bias_rad_s=np.radians(0.01), gyro_bias_rad_s_degc=0.0, gyro_scale=0.0)


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
