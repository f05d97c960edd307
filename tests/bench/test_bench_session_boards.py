"""The whole tool on boards drawn from within the data sheet, against their truth: the table it is judged by."""

from __future__ import annotations

import numpy as np
import pytest
from session_rig import Bench

from quavelet.bench.session import USUAL
from quavelet.bench.session_result import work_out
from quavelet.bench.session_verdict import verdict
from quavelet.core.units import DEG_PER_RAD, STANDARD_GRAVITY_M_S2

COLUMNS = ("accel offset, mg", "accel scale, %", "accel axes, deg", "bias, deg/s", "gyro scale, %", "gyro axes, deg")
LIMITS = (3.0, 0.3, 0.2, 0.01, 0.3, 0.2)


def errors_of(seed: int, out) -> list[float]:
    """What is left of each error of one board once the session is over, the worst axis."""
    bench = Bench(USUAL, out=out, seed=seed)
    assert bench.conduct()
    result = work_out(bench.evidence, utc="2026-01-01T00:00:00Z", version="0")
    assert all(finding.ok for finding in verdict(result))
    found, truth = result.record.calibration(), bench.bus.sensor
    t_s = np.array([bench.bus.chip.world_time_s(bench.clock.now_ns())])
    bias = found.gyro_bias_curve.at(truth.temperature_degc(t_s)) - bench.bus.chip.source.gyro_bias_rad_s(t_s)
    offset = np.array(found.accel_offset_m_s2) - bench.bus.chip.source.accel_bias_m_s2(t_s)[0]
    errors = [1e3 * np.abs(offset).max() / STANDARD_GRAVITY_M_S2]
    for matrix, scale, across in (
        (found.accel_matrix, truth.accel_scale, truth.accel_cross_axis),
        (found.gyro_matrix, truth.gyro_scale, truth.gyro_cross_axis),
    ):
        left = np.array(matrix) @ (np.diag(scale) + np.array(across)) - np.eye(3)
        errors += [100 * np.abs(np.diag(left)).max(), DEG_PER_RAD * np.abs(left - np.diag(np.diag(left))).max()]
        if len(errors) == 3:
            errors.append(float(DEG_PER_RAD * np.abs(bias).max()))
    return errors


@pytest.mark.parametrize("boards", [1, pytest.param(20, marks=pytest.mark.slow)])
def test_the_tool_finds_the_truth_of_drawn_boards(boards, tmp_path):
    table = np.array([errors_of(seed, tmp_path / f"{seed}") for seed in range(100, 100 + boards)])
    for name, limit, column in zip(COLUMNS, LIMITS, table.T, strict=True):
        print(f"{name:<18} limit {limit:<5g} 95 % below {np.percentile(column, 95):.3f}, most {column.max():.3f}")
    assert (np.percentile(table, 95, axis=0) < LIMITS).all()
