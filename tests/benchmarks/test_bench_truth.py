"""Moving attitude against measured truth, beside other people's filters in the same run (BROAD's metric).

Prints the table of root mean square inclination errors; asserts only that our default is no worse than the papers'
PID. All trials: `pytest -m slow tests/benchmarks/test_bench_truth.py`, three minutes.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from quavelet.attitude.doubt import Residual
from quavelet.attitude.pid import PidFilter, PidParams
from quavelet.calibration.still_bias import StillBias
from quavelet.core.blocks import Flag, ImuBlock
from quavelet.core.quaternion import inclination_between, normalise

TRUTH = Path(__file__).resolve().parents[3] / "shared" / "truth"
BIAS_RAD_S = np.radians(4.6 * np.array([0.6, -0.5, 0.6245]))
RESIDUAL = Residual(tilt_rad=0.005, gyro_bias_rad_s=2e-4, gyro_bias_rad_s_degc=0.0, gyro_scale=0.01)
PAPER = PidParams(kp=1.0, ki=0.02, kd=0.5)

Found = Callable[[np.ndarray, np.ndarray, float], np.ndarray]


def ours(params: PidParams, *, start: bool) -> Found:
    def run(gyro: np.ndarray, accel: np.ndarray, fs: float) -> np.ndarray:
        n = len(gyro)
        block = ImuBlock(
            t_ns=np.round(np.arange(1, n + 1) / fs * 1e9).astype(np.int64),
            period_s=np.full(n, 1 / fs),
            gap_ns=np.zeros(n, dtype=np.int64),
            flags=np.full(n, int(Flag.BIAS_UNKNOWN) if start else 0, dtype=np.uint32),
            gyro_rad_s=gyro,
            accel_m_s2=accel,
            temp_degc=np.full(n, 25.0),
            gyro_bias_rad_s=np.zeros((n, 3)),
            still=np.zeros(n, dtype=np.bool_),
        )
        return PidFilter(params, residual=RESIDUAL).process(StillBias().process(block)).q

    return run


def rivals() -> dict[str, Found]:
    found: dict[str, Found] = {}
    try:
        import vqf

        found["VQF"] = lambda gyro, accel, fs: vqf.VQF(1 / fs).updateBatch(gyro, accel)["quat6D"]
    except ImportError:
        pass
    return found


def rmse_deg(q: np.ndarray, trial: dict[str, np.ndarray], after_s: float) -> float:
    scored = trial["mov"].astype(bool) & trial["q_valid"].astype(bool)
    scored[: int(after_s * float(trial["fs"]))] = False
    truth = normalise(np.where(scored[:, None], trial["q_ref"], 1) / 32000.0)
    return float(np.degrees(np.sqrt((inclination_between(truth, q)[scored] ** 2).mean())))


@pytest.mark.benchmark
@pytest.mark.parametrize(
    "every", [pytest.param(5, id="every fifth trial"), pytest.param(1, id="all trials", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("set_name", ["broad", "openaxes"])
def test_inclination_error_on_trials_with_measured_truth(set_name, every, capsys):
    if not TRUTH.is_dir():
        pytest.skip("the trials are absent: no folder ../shared/truth beside the project")
    filters = {
        "quavelet, bias known": ours(PidParams(), start=False),
        "quavelet, starts by itself": ours(PidParams(), start=True),
        "paper's PID": ours(PAPER, start=False),
    } | rivals()
    table: dict[str, list[float]] = {name: [] for name in filters}
    biased: dict[str, list[float]] = {name: [] for name in filters}
    for file in sorted(TRUTH.glob(f"{set_name}_*.npz"))[::every]:
        trial = dict(np.load(file))
        gyro, accel = trial["gyr"] * trial["gyr_scale"], trial["acc"] * trial["acc_scale"]
        for name, run in filters.items():
            table[name].append(rmse_deg(run(gyro, accel, float(trial["fs"])), trial, 0.0))
            biased[name].append(rmse_deg(run(gyro + BIAS_RAD_S, accel, float(trial["fs"])), trial, 20.0))
    rival = np.mean(table["VQF"]) if "VQF" in table else np.nan
    with capsys.disabled():
        print(f"\n{set_name}: rms inclination error, deg (ratio to VQF in this run); with 4.6 deg/s of bias after 20 s")
        for name in filters:
            mean = np.mean(table[name])
            print(f"  {name:28} {mean:6.2f} ({mean / rival:4.1f})   {np.mean(biased[name]):6.2f}")
    assert np.mean(table["quavelet, bias known"]) < np.mean(table["paper's PID"])
    assert np.mean(biased["quavelet, starts by itself"]) < np.mean(biased["paper's PID"])
