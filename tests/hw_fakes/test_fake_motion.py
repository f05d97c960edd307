"""The truth is one: attitude, rate and specific force belong together."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from hw_fakes.motion import Still, Sway, Tilt, Turntable
from quavelet.core.units import STANDARD_GRAVITY_M_S2

MOTIONS = {
    "still": Still(roll_deg=20, pitch_deg=-70, yaw_deg=130),
    "tilt": Tilt(),
    "sway": Sway(),
    "turntable": Turntable(),
    "leaning turntable": Turntable(start_s=2, turn_deg=-900, rate_deg_s=120, ramp_s=0.5, axis_tilt_deg=35),
}


def scipy_rotation(q):
    return Rotation.from_quat(np.roll(q, -1, axis=-1))


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
def test_attitude_is_the_integral_of_the_rate_over_a_minute(motion):
    def derivative(t, q):
        x, y, z = motion.rate_rad_s(np.array([t]))[0]
        omega = np.array([[0, -x, -y, -z], [x, 0, z, -y], [y, -z, 0, x], [z, y, -x, 0]])
        return omega @ q / 2

    t_s = np.linspace(0, 60, 121)
    truth = motion.attitude(t_s)
    found = solve_ivp(derivative, (0, 60), truth[0], method="DOP853", t_eval=t_s, rtol=1e-10, atol=1e-10, max_step=0.05)
    error = scipy_rotation(found.y.T).inv() * scipy_rotation(truth)
    assert np.max(error.magnitude()) < 1e-6


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
def test_specific_force_is_gravity_seen_from_the_body(motion):
    t_s = np.linspace(-1, 60, 500)
    up = scipy_rotation(motion.attitude(t_s)).inv().apply([0, 0, STANDARD_GRAVITY_M_S2])
    assert np.allclose(motion.specific_force_m_s2(t_s), up, atol=1e-9)
    assert np.allclose(np.linalg.norm(motion.attitude(t_s), axis=1), 1)


def test_tilt_is_still_3_s_and_then_never_ends():
    t_s = np.arange(0, 600, 0.01)
    speed = np.linalg.norm(Tilt().rate_rad_s(t_s), axis=1)
    assert np.all(speed[t_s <= 3] == 0)
    for start in range(3, 600, 3):
        assert speed[(t_s > start) & (t_s < start + 3)].max() > 0.1
        assert np.all(speed[(t_s > start + 1.51) & (t_s < start + 2.99)] == 0)


def test_turntable_is_still_then_turns_once_then_is_still():
    table = Turntable()
    t_s = np.array([0.0, 5.0, 10.0, table.stop_s, 100.0])
    rate = np.degrees(table.rate_rad_s(t_s))
    assert np.allclose(rate[:, 2], [0, 0, 30, 0, 0])
    assert table.stop_s == pytest.approx(18)
    assert np.degrees(table.angle_rad(t_s)[0])[-1] == pytest.approx(360)
    assert np.abs(table.attitude(t_s)[-1]) == pytest.approx([1, 0, 0, 0], abs=1e-9)


def test_a_turn_too_short_for_its_ramps_is_refused():
    with pytest.raises(ValueError, match="larger turn_deg"):
        Turntable(turn_deg=10)


def test_sway_moves_from_the_first_moment():
    assert np.linalg.norm(Sway().rate_rad_s(np.array([0.0]))) > 1
