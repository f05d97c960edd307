"""Paper 001 without noise: its matrix as printed, its function, and what no denoising takes away."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from quavelet.alignment.two_vectors import UP, triad
from quavelet.core.blocks import FloatArray
from quavelet.core.euler import from_euler, to_euler
from quavelet.core.quaternion import from_matrix, to_matrix
from quavelet.core.units import DEG_PER_RAD
from quavelet.denoise.shrink import hard, improved, soft
from quavelet.study.experiment import Row, Verdict
from quavelet.study.paper001_simulation import ATTITUDE_DEG, AXES, FIELD_UT, G, angles_deg, off_deg, rms_of

SCALES = np.array([1.03, 0.90])
"""A 3 % error of scale of the accelerometer and -10 % of the magnetometer."""


def _scaled() -> tuple[FloatArray, FloatArray, FloatArray]:
    truth = to_matrix(from_euler(np.radians(np.array(ATTITUDE_DEG)), order="zxy"))
    return truth, SCALES[0] * truth.T @ (G * UP), SCALES[1] * truth.T @ FIELD_UT


def triad_row() -> Row:
    """TRIAD on unit vectors stays orthogonal (1d)."""
    _, force, field = _scaled()
    matrix = triad(UP, FIELD_UT, force, field)
    off = float(np.abs(matrix @ matrix.T - np.eye(3)).max())
    return Row("1d", "TRIAD with errors of scale, largest |C C' - I|", got=off, unit="", low=0.0, high=1e-12)


def printed_matrix() -> list[Row]:
    """[f, f x M, (f x M) x f], world over body, with columns as long as they come (in g and gauss)."""
    truth, force, field = _scaled()

    def columns(f: FloatArray, m: FloatArray) -> FloatArray:
        f, m = f / G, m / 100.0
        return np.stack([f, np.cross(f, m), np.cross(np.cross(f, m), f)], axis=-1)

    matrix = columns(G * UP, FIELD_UT) @ np.linalg.inv(columns(force, field))
    found = np.array(
        [np.arcsin(matrix[2, 1]), np.arctan2(-matrix[2, 0], matrix[2, 2]), np.arctan2(matrix[0, 1], matrix[1, 1])]
    )
    true = to_euler(from_matrix(truth), order="zxy")[[1, 0, 2]]
    note = "columns must be unit vectors: the sensors' scales go into the attitude otherwise"
    return [
        Row("E1", "as printed with errors of scale, largest |C C' - I|",
            got=float(np.abs(matrix @ matrix.T - np.eye(3)).max()), unit="", verdict=Verdict.REFUTED, note=note),
        *(
            Row("E1", f"as printed with errors of scale, {axis} off", got=value, unit="deg")
            for axis, value in zip(AXES, (DEG_PER_RAD * (found - true)).tolist(), strict=True)
        ),
    ]  # fmt: skip


def functions() -> list[Row]:
    """The improved function is odd, and between soft and hard (1e)."""
    w = np.linspace(-10.0, 10.0, 4001)
    t = 1.7
    eta: Callable[[float], FloatArray] = lambda k: improved(w, t, k=k, alpha=1.0)  # noqa: E731
    size = np.abs(eta(16.0))
    beyond = np.maximum(np.abs(soft(w, t)) - size, size - np.abs(hard(w, t)))
    checks = {
        "eta(T)": float(np.abs(improved(np.array([t]), t, k=16.0, alpha=1.0))[0]),
        "eta(w) + eta(-w)": float(np.abs(eta(16.0) + eta(16.0)[::-1]).max()),
        "beyond soft or hard": float(np.maximum(beyond, 0.0).max()),
        "k = 1e-6 against soft": float(np.abs(eta(1e-6) - soft(w, t)).max()),
        "k = 1e6 against hard": float(np.abs(eta(1e6) - hard(w, t))[np.abs(np.abs(w) - t) > 1e-3].max()),
    }
    return [
        Row("1e", f"improved function, {what}", got=value, unit="", low=0.0, high=1e-5)
        for what, value in checks.items()
    ]


def budget(rng: np.random.Generator, runs: int) -> list[Row]:
    """What noise has no part in: zero-g offset and hard iron, in random directions."""
    n = 200 * runs
    truth = to_matrix(from_euler(np.radians(np.array(ATTITUDE_DEG)), order="zxy"))
    rows = []
    true = np.array([ATTITUDE_DEG])
    force = truth.T @ (G * UP) + 0.005 * G * rng.uniform(-1.0, 1.0, (1, n, 3))
    found = off_deg(angles_deg(force, np.broadcast_to(truth.T @ FIELD_UT, force.shape)), true)
    rows += [
        Row("E2", f"zero-g offset within 5 mg, {axis}, rms", got=value, unit="deg")
        for axis, value in zip(AXES, rms_of(found).tolist(), strict=True)
    ]
    for iron_ut in (2.0, 10.0):
        direction = rng.standard_normal((1, n, 3))
        iron = iron_ut * direction / np.linalg.norm(direction, axis=-1, keepdims=True)
        found = off_deg(angles_deg(np.broadcast_to(truth.T @ (G * UP), iron.shape), truth.T @ FIELD_UT + iron), true)
        rows.append(
            Row("E2", f"hard iron of {10 * iron_ut:g} mG, heading, rms", got=float(rms_of(found)[2]), unit="deg",
                note="no denoising takes it away: calibrate the magnetometer first")
        )  # fmt: skip
    return rows
