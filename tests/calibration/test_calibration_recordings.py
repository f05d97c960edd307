"""Two real chips, turned by hand through some twenty poses: half of the poses calibrates the other half."""

from __future__ import annotations

import numpy as np
import pytest
from imu_blocks import imu_block

from quavelet.calibration.accelerometer import fit_accelerometer
from quavelet.calibration.poses import apart, in_g, still_poses
from quavelet.core.blocks import ImuBlock
from quavelet.core.errors import CalibrationError


def recorded(path) -> ImuBlock:
    data = np.load(path)
    return imu_block(data["gyro_rad_s"], data["acc_m_s2"], period_s=1.0 / float(data["rate"]))


def norm_rms(forces_g) -> float:
    return float(np.sqrt(((np.linalg.norm(forces_g, axis=1) - 1.0) ** 2).mean()))


@pytest.mark.parametrize("name", ["mikoff_imu0", "mikoff_imu1"])
def test_half_of_the_still_poses_calibrates_the_other_half(recordings, name):
    poses = apart(still_poses(recorded(recordings / f"{name}.npz"), shortest_s=0.5))
    assert len(poses) >= 18
    rng, before, after = np.random.default_rng(6), [], []
    for _ in range(40):
        order = rng.permutation(len(poses))
        used, kept = ([poses[k] for k in part] for part in np.array_split(order, 2))
        before.append(norm_rms(in_g(kept)))
        try:
            fit = fit_accelerometer(used)
        except CalibrationError:
            after.append(np.inf)  # Half of the poses left an axis out, which it said.
            continue
        after.append(norm_rms(in_g([fit.pose(pose) for pose in kept])))
    print(
        f"\n{name}: norm of the poses left out {100 * np.median(before):.2f} % -> {100 * np.median(after):.3f} % of 1 g"
    )
    assert np.median(before) > 0.018
    assert np.median(after) < 0.003
