"""How well boards drawn from the data sheet's limits are calibrated: `python tests/calibration/boards_table.py [N]`."""

from __future__ import annotations

import sys

import numpy as np
from simulated_boards import Calibrated, G, calibrated_board

from quavelet.calibration.accelerometer import sphere_points

BARS = {
    "gyroscope bias, deg/s": 0.01,
    "gyroscope bias on any face, deg/s": 0.01,
    "accelerometer offset, mg": 3.0,
    "accelerometer scale, %": 0.3,
    "accelerometer misalignment, deg": 0.2,
    "gyroscope scale, %": 0.3,
    "gyroscope misalignment, deg": 0.2,
    "attitude at rest in any pose, deg": 0.3,
}
"""Of the largest error of a board's axes: 95 % of boards must be within."""
OFF = ~np.eye(3, dtype=bool)
Errors = tuple[dict[str, float], dict[str, np.ndarray], float]


def errors_of(c: Calibrated) -> Errors:
    """Largest error of each kind, errors in sigmas by kind, and the largest uncalibrated attitude error in deg."""
    board = c.board
    shown = np.diag(board.accel_scale) + np.array(board.accel_cross_axis)
    matrix, zero = np.array(c.accel.matrix), np.array(board.accel_bias_m_s2) / G
    offset = np.array(c.accel.offset_m_s2) / G - zero
    left = matrix @ shown - np.eye(3)
    gyro_shown = np.diag(board.gyro_scale) + np.array(board.gyro_cross_axis)
    gyro_left = np.array(c.turns.matrix) @ gyro_shown - np.eye(3)
    warmer = c.bias.reference_degc - board.bias_temp_degc
    true_bias = np.array(board.gyro_bias_rad_s) + warmer * np.array(board.gyro_bias_rad_s_degc)
    bias = np.array(c.bias.coefficients_rad_s[0]) - true_bias
    per_g = np.array(c.bias.per_force) * G - np.array(board.gyro_per_g_rad_s)
    on_faces = np.array([bias + sign * per_g[:, k] for k in range(3) for sign in (1, -1)])
    up = sphere_points(200)
    measured = up @ shown.T + zero
    found = (measured - np.array(c.accel.offset_m_s2) / G) @ matrix.T
    errors = {
        "gyroscope bias, deg/s": np.degrees(np.abs(bias).max()),
        "gyroscope bias on any face, deg/s": np.degrees(np.abs(on_faces).max()),
        "accelerometer offset, mg": 1e3 * np.abs(offset).max(),
        "accelerometer scale, %": 100 * np.abs(np.diag(left)).max(),
        "accelerometer misalignment, deg": np.degrees(np.abs(left[OFF]).max()),
        "gyroscope scale, %": 100 * np.abs(np.diag(gyro_left)).max(),
        "gyroscope misalignment, deg": np.degrees(np.abs(gyro_left[OFF]).max()),
        "attitude at rest in any pose, deg": angles_deg(found, up).max(),
    }
    accel_sigma, gyro_sigma = c.accel.sigma[3:].reshape(3, 3), c.turns.sigma.reshape(3, 3)
    in_sigmas = {
        "gyroscope bias": bias / c.bias.sigma_at(c.bias.reference_degc),
        "accelerometer offset": offset / c.accel.sigma[:3],
        "accelerometer scale": np.diag(left) / np.diag(accel_sigma),
        "accelerometer misalignment": left[OFF] / accel_sigma[OFF],
        "gyroscope scale": np.diag(gyro_left) / np.diag(gyro_sigma),
        "gyroscope misalignment": gyro_left[OFF] / gyro_sigma[OFF],
    }
    return errors, in_sigmas, float(angles_deg(measured, up).max())


def angles_deg(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    cosine = (a * b).sum(axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
    return np.degrees(np.arccos(np.minimum(1.0, cosine)))


def table(seeds: range) -> tuple[dict[str, float], dict[str, float]]:
    """`show` of boards whose samples go to the estimators alone."""
    return show([errors_of(calibrated_board(seed)) for seed in seeds], "calibrated by hand on a bench")


def show(each: list[Errors], how: str) -> tuple[dict[str, float], dict[str, float]]:
    """The 95 % point of each error, and the part of the truths within 1.96 sigmas; printed."""
    points = {name: float(np.quantile([errors[name] for errors, _, _ in each], 0.95)) for name in BARS}
    covered = {name: float((np.abs([z[name] for _, z, _ in each]) < 1.96).mean()) for name in each[0][1]}
    raw = [before for _, _, before in each]
    print(f"\n{len(each)} boards drawn from the data sheet's limits, {how}")
    print(f"{'largest error of a board':<38}{'95 % within':>12}{'bar':>8}{'worst':>9}")
    for name, bar in BARS.items():
        print(f"{name:<38}{points[name]:>12.4f}{bar:>8g}{max(errors[name] for errors, _, _ in each):>9.4f}")
    print(f"{'  uncalibrated':<38}{np.quantile(raw, 0.95):>12.4f}{'':>8}{max(raw):>9.4f}")
    print(
        f"{'truth within 1.96 of the stated sigmas':<40}"
        + ", ".join(f"{n} {100 * s:.1f} %" for n, s in covered.items())
    )
    return points, covered


if __name__ == "__main__":
    table(range(int(sys.argv[1]) if len(sys.argv) > 1 else 200))
