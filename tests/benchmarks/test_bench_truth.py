"""Moving attitude against measured truth, beside other people's filters in the same run (BROAD's metric).

Prints the table of root mean square inclination errors; asserts that our default is better than the plain PID and,
where it is installed, than VQF. All trials: `pytest -m slow tests/benchmarks/test_bench_truth.py`, some minutes.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from imu_blocks import imu_block

from quavelet.attitude.doubt import Residual
from quavelet.attitude.params import FilterParams
from quavelet.calibration.still_bias import StillBias
from quavelet.core.blocks import Flag
from quavelet.core.quaternion import inclination_between, normalise

try:
    import vqf
except ImportError:
    vqf = None
try:
    import imufusion
except ImportError:
    imufusion = None
try:
    import ahrs
except ImportError:
    ahrs = None

TRUTH = Path(__file__).resolve().parents[3] / "shared" / "truth"
BIAS_RAD_S = np.radians(4.6 * np.array([0.6, -0.5, 0.6245]))
RESIDUAL = Residual(tilt_rad=0.005, gyro_bias_rad_s=2e-4, gyro_bias_rad_s_degc=0.0, gyro_scale=0.003)
"""Of a sensor that was calibrated, as those of these sets were."""
PLAIN = FilterParams(kind="pid", kp=1.0, ki=0.0)
PAPER = FilterParams(kind="pid", kp=1.0, ki=0.02, kd=0.5)

Found = Callable[[np.ndarray, np.ndarray, float], np.ndarray]


def ours(params: FilterParams, *, start: bool) -> Found:
    def run(gyro: np.ndarray, accel: np.ndarray, fs: float) -> np.ndarray:
        block = imu_block(gyro, accel, period_s=1 / fs, flags=int(Flag.BIAS_UNKNOWN) if start else 0)
        return params.build(residual=RESIDUAL).process(StillBias().process(block)).q

    return run


def rivals(*, slow_ones: bool) -> dict[str, Found]:
    """Other people's filters with their defaults, those that are installed. Those of ahrs are Python loops."""
    found: dict[str, Found] = {}
    if vqf is not None:
        found["VQF"] = lambda gyro, accel, fs: vqf.VQF(1 / fs).updateBatch(gyro, accel)["quat6D"]
    if imufusion is not None:
        found["imufusion"] = _imufusion
    if ahrs is not None and slow_ones:
        found["Madgwick (ahrs)"] = lambda gyro, accel, fs: ahrs.filters.Madgwick(gyr=gyro, acc=accel, frequency=fs).Q
        found["Mahony (ahrs)"] = lambda gyro, accel, fs: ahrs.filters.Mahony(gyr=gyro, acc=accel, frequency=fs).Q
    return found


def _imufusion(gyro: np.ndarray, accel: np.ndarray, fs: float) -> np.ndarray:
    other = imufusion.Ahrs()
    other.set_sample_period(1 / fs)
    q = np.empty((len(gyro), 4))
    for k, (rate, force) in enumerate(zip(np.degrees(gyro), accel / 9.80665, strict=True)):
        other.update_no_magnetometer(rate, force)
        q[k] = other.get_quaternion()
    return q


def rmse_deg(q: np.ndarray, trial: dict[str, np.ndarray], after_s: float) -> float:
    scored = trial["mov"].astype(bool) & trial["q_valid"].astype(bool)
    scored[: int(after_s * float(trial["fs"]))] = False
    truth = normalise(np.where(scored[:, None], trial["q_ref"], 1) / 32000.0)
    return float(np.degrees(np.sqrt((inclination_between(truth, q)[scored] ** 2).mean())))


@pytest.mark.benchmark
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    "every", [pytest.param(8, id="every eighth trial"), pytest.param(1, id="all trials", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("set_name", ["broad", "openaxes"])
def test_inclination_error_on_trials_with_measured_truth(set_name, every, capsys):
    if not TRUTH.is_dir():
        pytest.skip("the trials are absent: no folder ../shared/truth beside the project")
    filters = {
        "quavelet, bias known": ours(FilterParams(), start=False),
        "quavelet, starts by itself": ours(FilterParams(), start=True),
        "plain PID, kp 1, ki 0": ours(PLAIN, start=True),
        "paper's PID": ours(PAPER, start=True),
    } | rivals(slow_ones=every == 1)
    table: dict[str, list[float]] = {name: [] for name in filters}
    biased: dict[str, list[float]] = {name: [] for name in filters}
    for file in sorted(TRUTH.glob(f"{set_name}_*.npz"))[::every]:
        trial = dict(np.load(file))
        gyro, accel = trial["gyr"] * trial["gyr_scale"], trial["acc"] * trial["acc_scale"]
        for name, run in filters.items():
            table[name].append(rmse_deg(run(gyro, accel, float(trial["fs"])), trial, 0.0))
            biased[name].append(rmse_deg(run(gyro + BIAS_RAD_S, accel, float(trial["fs"])), trial, 20.0))
    rival = float(np.mean(table["VQF"])) if "VQF" in table else np.nan
    with capsys.disabled():
        print(f"\n{set_name}: rms inclination error, deg (ratio to VQF in this run); with 4.6 deg/s of bias after 20 s")
        for name in filters:
            mean = np.mean(table[name])
            print(f"  {name:28} {mean:6.2f} ({mean / rival:4.1f})   {np.mean(biased[name]):6.2f}")
        for name in ("vqf", "imufusion", "ahrs"):
            if globals()[name] is None:
                print(f"  {name} is not installed: no row for it")
    # BROAD begins at rest with a bias, OpenAXES in motion without one.
    ours_is = "quavelet, starts by itself" if set_name == "broad" else "quavelet, bias known"
    for name in ("plain PID, kp 1, ki 0", "paper's PID"):
        assert np.mean(table[ours_is]) < np.mean(table[name])
        assert np.mean(biased["quavelet, starts by itself"]) < np.mean(biased[name])
    if "VQF" in table and every == 1:
        assert np.mean(table[ours_is]) < rival
        assert np.mean(biased["quavelet, starts by itself"]) < np.mean(biased["VQF"])
