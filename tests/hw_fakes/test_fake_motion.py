"""The truth is one: attitude, rate and specific force belong together."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from hw_fakes.world.motion import Still, Sway, Tilt, Turntable
from hw_fakes.world.motion_base import EarthField
from hw_fakes.world.motion_bench import Coning, SixFaces
from hw_fakes.world.motion_carried import Drone, Vibration, Walk
from hw_fakes.world.motion_show import Move, Show
from quavelet.core.units import STANDARD_GRAVITY_M_S2

MOTIONS = {
    "still": Still(roll_deg=20, pitch_deg=-70, yaw_deg=130),
    "tilt": Tilt(),
    "sway": Sway(),
    "turntable": Turntable(),
    "leaning turntable": Turntable(start_s=2, turn_deg=-900, rate_deg_s=120, ramp_s=0.5, axis_tilt_deg=35),
    "six faces": SixFaces(),
    "six faces in haste": SixFaces(rest_s=0.3, turn_s=0.7),
    "coning": Coning(),
    "wide coning": Coning(half_angle_deg=70, turns_hz=-3),
    "show": Show(),
}
TRAVELLING = {
    "walk": Walk(),
    "run to the right": Walk(start_s=1, step_hz=2.8, speed_m_s=3, turn_deg_s=-20, rise_m=0.05, surge_m=0.02),
    "drone": Drone(),
    "drone with one tone": Drone(vibrations=(Vibration(hz=11, accel_m_s2=(3, 4, 5), rate_deg_s=(30, 40, 50)),)),
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


@pytest.mark.parametrize("motion", TRAVELLING.values(), ids=TRAVELLING)
def test_attitude_is_the_integral_of_the_rate_though_it_vibrates(motion):
    # Each step of 0.1 ms is one rotation, exact to the fourth order (Magnus, two Gauss points); no step-size control,
    # which would take minutes at these frequencies.
    step_s, steps = 1e-4, 600_000
    middle_s = (np.arange(steps) + 0.5) * step_s
    first, second = (motion.rate_rad_s(middle_s + side * step_s / 12**0.5) for side in (-1, 1))
    turns = Rotation.from_rotvec(step_s / 2 * (first + second) + 3**0.5 / 12 * step_s**2 * np.cross(first, second))
    start = scipy_rotation(motion.attitude(np.array([0.0])))[0]
    for end_s in (60.0, 37.5, 6.1):
        part = turns[: round(end_s / step_s)]
        while len(part) > 1:
            if len(part) % 2:
                part = Rotation.concatenate([part, Rotation.identity(1)])
            part = part[::2] * part[1::2]
        error = (start * part[0]).inv() * scipy_rotation(motion.attitude(np.array([end_s])))[0]
        assert error.magnitude() < 1e-6


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
def test_specific_force_is_gravity_seen_from_the_body(motion):
    t_s = np.linspace(-1, 60, 500)
    up = scipy_rotation(motion.attitude(t_s)).inv().apply([0, 0, STANDARD_GRAVITY_M_S2])
    assert np.allclose(motion.specific_force_m_s2(t_s), up, atol=1e-9)
    assert np.allclose(np.linalg.norm(motion.attitude(t_s), axis=1), 1)


@pytest.mark.parametrize("motion", TRAVELLING.values(), ids=TRAVELLING)
def test_specific_force_is_that_of_the_place_in_motion(motion):
    t_s, h = np.random.default_rng(3).uniform(0, 60, 2000), 2e-4
    at = [motion.position_m(t_s + k * h) for k in (-2, -1, 0, 1, 2)]
    acceleration = (-at[0] + 16 * at[1] - 30 * at[2] + 16 * at[3] - at[4]) / (12 * h**2)
    felt = scipy_rotation(motion.attitude(t_s)).apply(motion.specific_force_m_s2(t_s))
    assert np.allclose(felt, acceleration + [0, 0, STANDARD_GRAVITY_M_S2], atol=1e-3)
    assert np.ptp(felt[:, 2]) > 1


@pytest.mark.parametrize("motion", (MOTIONS | TRAVELLING).values(), ids=MOTIONS | TRAVELLING)
def test_magnetic_field_is_the_worlds_seen_from_the_body(motion):
    t_s = np.linspace(-1, 60, 500)
    world = scipy_rotation(motion.attitude(t_s)).apply(motion.magnetic_field_ut(t_s))
    assert np.allclose(world, motion.earth_field.world_ut, atol=1e-9)


def test_field_dips_down_north_of_the_equator_and_goes_east_with_the_declination():
    field = EarthField(strength_ut=50, inclination_deg=60, declination_deg=0)
    assert field.world_ut == pytest.approx([0, 25, -50 * 0.75**0.5])
    east, north, up = EarthField(strength_ut=50, inclination_deg=-60, declination_deg=30).world_ut
    assert np.degrees(np.arctan2(east, north)) == pytest.approx(30)
    assert np.hypot(east, north) == pytest.approx(25)
    assert up == pytest.approx(50 * 0.75**0.5)


def test_compass_of_a_turned_board_shows_where_north_went():
    # A board turned by 90 deg to the left, its x axis now north, finds the field's horizontal part along x.
    still = Still(yaw_deg=90, earth_field=EarthField(inclination_deg=0, declination_deg=0, strength_ut=40))
    assert still.magnetic_field_ut(np.zeros(1))[0] == pytest.approx([40, 0, 0])


@pytest.mark.parametrize("motion", [Walk(), Drone()], ids=["walk", "drone"])
def test_who_travels_stands_still_first(motion):
    t_s = np.linspace(-1, motion.start_s, 100)
    assert not motion.rate_rad_s(t_s).any()
    assert np.allclose(motion.specific_force_m_s2(t_s), [0, 0, STANDARD_GRAVITY_M_S2])
    assert np.ptp(motion.position_m(t_s), axis=0) == pytest.approx(0)


def test_six_faces_come_up_in_turn_and_for_ever():
    faces = SixFaces(rest_s=3, turn_s=1.5)
    for lap in (0, 1, 7, 8, 1000):
        middle_s = (6 * lap + np.arange(6)) * 4.5 + 1.5
        up = faces.specific_force_m_s2(middle_s) / STANDARD_GRAVITY_M_S2
        assert np.allclose(up, np.concatenate([np.eye(3)[[2, 0, 1]], -np.eye(3)[[2, 0, 1]]]), atol=1e-12)


def test_six_faces_rest_and_turn_as_long_as_asked_for():
    faces = SixFaces(rest_s=3, turn_s=1.5)
    t_s = np.arange(0, 300, 0.01)
    speed = np.degrees(np.linalg.norm(faces.rate_rad_s(t_s), axis=1))
    assert np.array_equal(speed > 1e-9, (t_s % 4.5 > 3 + 1e-6) & (t_s % 4.5 < 4.5 - 1e-6))
    assert speed.max() == pytest.approx(90 / 1.5 * 1.875, rel=1e-3)


@pytest.mark.parametrize("bad", [{"rest_s": 0}, {"turn_s": 0}, {"turn_s": -1}, {"turn_s": float("nan")}])
def test_faces_without_time_are_refused(bad):
    with pytest.raises(ValueError, match="above 0"):
        SixFaces(**bad)


def test_coning_adds_up_to_a_turn_that_is_not_there():
    coning = Coning(half_angle_deg=20, turns_hz=2)
    t_s = np.linspace(0, 10, 10_000, endpoint=False)
    assert np.allclose(coning.attitude(t_s), coning.attitude(t_s + 0.5))
    yaw_rate_deg_s = np.degrees(coning.rate_rad_s(t_s).mean(0))
    # The solid angle of the cone, once a turn.
    assert yaw_rate_deg_s == pytest.approx([0, 0, -2 * 360 * (1 - np.cos(np.radians(20)))], abs=1e-9)


def test_a_show_moves_about_every_axis_rests_between_and_comes_again():
    show = Show()
    t_s = np.arange(0.0, show.start_s + show.lap_s, 0.01)
    rate_deg_s = np.degrees(show.rate_rad_s(t_s))
    still = np.linalg.norm(rate_deg_s, axis=1) < 1e-9
    assert still[t_s < show.start_s].all()
    assert (np.abs(rate_deg_s).max(axis=0) > 60).all() and np.abs(rate_deg_s).max() < 200
    assert 0.35 < still[t_s > show.start_s].mean() < 0.7
    later_s = t_s[t_s > show.start_s]
    assert np.allclose(show.attitude(later_s), show.attitude(later_s + 7 * show.lap_s), atol=1e-9)
    # The longest time without a rest of a second, in which the bias could be found anew.
    moving_s = np.diff(t_s[still]).max()
    assert moving_s < 9.0


@pytest.mark.parametrize(
    "bad", [{"moves": ()}, {"moves": (Move(5, 0, 0, 1, 1),)}, {"moves": (Move(0, 0, 0, 0, 1),)}, {"sway_s": 0}]
)
def test_a_show_that_cannot_be_is_refused(bad):
    with pytest.raises(ValueError, match=r"end with|above 0"):
        Show(**bad)


def test_walk_goes_at_its_speed_in_its_circle():
    walk = Walk(start_s=0, surge_m=0)
    place = walk.position_m(np.array([10.0, 10.01, 40.0]))
    assert np.linalg.norm(place[1, :2] - place[0, :2]) / 0.01 == pytest.approx(1.4, rel=1e-3)
    assert np.linalg.norm(place[:, :2], axis=1) == pytest.approx(1.4 / np.radians(6))
    forward = scipy_rotation(walk.attitude(np.array([10.0])))[0].apply([1, 0, 0])[:2]
    way = (place[1] - place[0])[:2]
    assert forward @ way / np.linalg.norm(way) > 0.99


def test_walk_is_felt_at_the_frequency_of_the_steps():
    t_s = np.arange(10, 110, 0.01)
    felt = Walk(step_hz=1.7).specific_force_m_s2(t_s)
    spectrum = np.abs(np.fft.rfft(felt - felt.mean(0), axis=0))
    assert np.fft.rfftfreq(len(t_s), 0.01)[spectrum[:, [0, 2]].argmax(0)] == pytest.approx([1.7, 1.7], abs=0.01)


def test_walk_straight_on_is_refused():
    with pytest.raises(ValueError, match="turn_deg_s"):
        Walk(turn_deg_s=0)


def test_rotors_that_spin_up_at_once_are_refused():
    with pytest.raises(ValueError, match="ramp_s"):
        Drone(ramp_s=0)


def tone_in_counts(make_board, dlpf, hz):
    """Amplitudes at `hz` of the seven words of a hovering drone's chip, through the FIFO at 1 kHz."""
    shake = Vibration(hz=hz, accel_m_s2=(1, 2, 5), rate_deg_s=(20, 30, 40))
    board = make_board(motion=Drone(start_s=0, ramp_s=0.5, lean_deg=(0.5, 0.5, 0), vibrations=(shake,)))
    board.wake(dlpf=dlpf)
    board.wait_ms(1000)
    board.start_fifo()
    counts = board.collect(2).astype(float)
    t_s = np.arange(len(counts)) * 1e-3
    slow = np.vander(t_s - 1, 8)
    basis = np.column_stack([np.sin(2 * np.pi * hz * t_s), np.cos(2 * np.pi * hz * t_s), slow])
    return np.hypot(*np.linalg.lstsq(basis, counts, rcond=None)[0][:2])


@pytest.mark.parametrize(("hz", "dlpf", "least", "most"), [(60, 1, 0.9, 1.0), (180, 3, 0, 0.2), (180, 6, 0, 0.05)])
def test_vibration_above_the_low_pass_filter_is_reduced_by_it(make_board, hz, dlpf, least, most):
    full = np.array([1, 2, 5, 20, 30, 40]) * np.repeat([16384 / STANDARD_GRAVITY_M_S2, 131], 3)
    gain = np.delete(tone_in_counts(make_board, dlpf, hz), 3) / full
    assert np.all((gain > least) & (gain < most))


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
