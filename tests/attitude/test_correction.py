"""The PID correction: what each term costs on a still board with the data sheet's noise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quavelet.attitude.correction import Correction, Gains, corrected
from quavelet.attitude.kernel import Quaternion, standing, step, tilt_error, up_in_body
from quavelet.core.euler import to_euler

T_S = 0.01
GYRO_SD_RAD_S = np.radians(0.005) * np.sqrt(50.0)
ACCEL_SD_G = 400e-6 * np.sqrt(50.0)


def tilt_sd_deg(gains: Gains, seed: int) -> np.ndarray:
    """Spread of roll and pitch over 60 s of a still, level board at 100 Hz, in deg."""
    rng = np.random.default_rng(seed)
    rates = rng.normal(0.0, GYRO_SD_RAD_S, (6000, 3)).tolist()
    forces = rng.normal([0.0, 0.0, 1.0], ACCEL_SD_G, (6000, 3)).tolist()
    q: Quaternion = standing(tuple(np.mean(forces[:500], axis=0)))
    loop, track = Correction(), []
    for rate, force in zip(rates, forces, strict=True):
        held = tuple(r + c for r, c in zip(rate, loop.rate_rad_s, strict=True))
        q = step(q, held, T_S, "rk4")
        loop = corrected(loop, tilt_error(q, tuple(force)), up_in_body(q), T_S, gains)
        track.append(q)
    return np.degrees(to_euler(np.array(track)).std(axis=0, ddof=1))[:2]


def gains(**changes: float) -> Gains:
    values = {"kp": 1.0, "ki": 0.0, "kd": 0.0, "kd_tau_s": 0.5, "integral_limit_rad_s": 0.05} | changes
    return Gains(**values)


@pytest.mark.parametrize(
    ("which", "least_deg", "most_deg"),
    [
        (gains(), 0.010, 0.014),
        (gains(ki=0.02), 0.010, 0.014),
        (gains(kd=0.5), 0.011, 0.019),
    ],
    ids=["P", "PI", "PID with its derivative low-passed"],
)
def test_the_loop_is_as_quiet_as_theory_says(which, least_deg, most_deg):
    sd = np.mean([tilt_sd_deg(which, seed) for seed in range(20201230, 20201233)], axis=0)
    assert (least_deg < sd).all(), sd
    assert (sd < most_deg).all(), sd


def test_an_unfiltered_derivative_would_pass_the_noise_to_the_angles():
    """The trap that the low-pass is there for: a time constant far below the step is no low-pass."""
    sd = tilt_sd_deg(gains(kd=0.5, kd_tau_s=1e-6), 20201230)
    assert (sd > 0.08).all()
    assert (sd < 0.11).all()


vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


@given(errors=st.lists(vectors, min_size=1, max_size=30), limit=st.floats(0.001, 0.5))
def test_the_integral_never_winds_up_beyond_its_limit(errors, limit):
    loop = Correction()
    for error in errors:
        loop = corrected(loop, error, (0.0, 0.0, 1.0), 0.1, gains(ki=5.0, integral_limit_rad_s=limit))
        assert max(map(abs, loop.integral_rad_s)) <= limit


@given(errors=st.lists(vectors, min_size=1, max_size=10), up=vectors.filter(lambda v: np.linalg.norm(v) > 0.1))
def test_the_derivative_never_steers_heading(errors, up):
    unit = tuple(np.array(up) / np.linalg.norm(up))
    loop = Correction()
    for error in errors:
        loop = corrected(loop, error, unit, 0.01, gains(kp=0.0, kd=0.5))
        assert abs(np.dot(loop.rate_rad_s, unit)) < 1e-9


def test_the_integral_finds_a_constant_bias():
    rate, force = (0.01, -0.02, 0.0), (0.0, 0.0, 9.8)
    q, loop = (1.0, 0.0, 0.0, 0.0), Correction()
    for _ in range(20_000):
        held = tuple(r + c for r, c in zip(rate, loop.rate_rad_s, strict=True))
        q = step(q, held, T_S, "rk4")
        loop = corrected(loop, tilt_error(q, force), up_in_body(q), T_S, gains(ki=0.1))
    assert np.allclose(loop.integral_rad_s, [-0.01, 0.02, 0.0], atol=1e-4)
