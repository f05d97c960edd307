"""The mounting is told from two poses, whatever it is and whatever the settings say it was."""

from __future__ import annotations

import itertools
import tomllib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from quavelet.calibration.mounting_check import Held, judged
from quavelet.core.instruction import FACES
from quavelet.core.mounting import AS_THE_CHIP, Axes, rotation
from quavelet.core.quaternion import from_rotation_vector, rotate
from quavelet.core.units import STANDARD_GRAVITY_M_S2
from quavelet.settings import parse_settings


def is_mounting(axes: tuple[str, ...]) -> bool:
    try:
        rotation((axes[0], axes[1], axes[2]))
    except ValueError:
        return False
    return True


MOUNTINGS: list[Axes] = [(x, y, z) for x, y, z in itertools.product(FACES, repeat=3) if is_mounting((x, y, z))]


def seen(body: NDArray[np.float64], *, true: Axes, said: Axes) -> NDArray[np.float64]:
    """A direction in the real body, as it is shown in the axes of a body that is said to be mounted otherwise."""
    shown: NDArray[np.float64] = np.array(rotation(said)) @ np.array(rotation(true)).T @ body
    return shown


def up_when_lifted(deg: float, *, askew_deg: float = 0.0) -> NDArray[np.float64]:
    """The vertical in a body whose front was lifted, or, askew, another side of it."""
    a, b = np.radians([deg, askew_deg])
    return np.array([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)])


@pytest.mark.parametrize("true", MOUNTINGS, ids="".join)
def test_all_24_mountings_are_found_whichever_of_24_the_settings_have(true: Axes) -> None:
    assert len(MOUNTINGS) == 24
    for said in MOUNTINGS:
        found = judged(
            seen(np.array([0.0, 0.0, 1.0]), true=true, said=said),
            seen(up_when_lifted(35.0), true=true, said=said),
            axes=said,
        )
        assert found.verdict == ("right" if said == true else "wrong"), (said, found.says)
        assert found.axes == (None if said == true else true)
        if said != true:
            # What is to be put into the settings is what the settings take.
            assert parse_settings(tomllib.loads(found.toml), where="there").mounting.axes == true
            assert all(face in found.says for name, face in zip("xz", (true[0], true[2]), strict=True)
                       if face != said["xyz".index(name)])  # fmt: skip


@given(
    true=st.sampled_from(MOUNTINGS),
    said=st.sampled_from(MOUNTINGS),
    off=st.tuples(*[st.floats(-0.14, 0.14)] * 2),
    lifted_deg=st.floats(20.0, 60.0),
    askew_deg=st.floats(-15.0, 15.0),
)
@settings(max_examples=300)
def test_a_chip_that_leans_by_some_degrees_and_a_hand_that_is_not_exact_do_no_harm(
    true, said, off, lifted_deg, askew_deg
) -> None:
    lean = from_rotation_vector(np.array([*off, 0.0]))
    level = seen(rotate(lean, np.array([0.0, 0.0, 1.0])), true=true, said=said)
    lifted = seen(rotate(lean, up_when_lifted(lifted_deg, askew_deg=askew_deg)), true=true, said=said)
    found = judged(level, lifted, axes=said)
    assert found.verdict == ("right" if said == true else "wrong")
    assert found.axes == (None if said == true else true)


@pytest.mark.parametrize(
    ("level", "lifted", "why"),
    [
        (up_when_lifted(0.0), up_when_lifted(8.0), "lifted by 8 degrees only"),
        (up_when_lifted(0.0), up_when_lifted(85.0), "lifted by 85 degrees: "),
        (up_when_lifted(0.0), up_when_lifted(180.0), "lifted by 180 degrees: "),
        (up_when_lifted(0.0), up_when_lifted(35.0, askew_deg=44.0), "askew"),
        (up_when_lifted(0.0), up_when_lifted(35.0, askew_deg=-135.0), "askew"),
        (up_when_lifted(33.0), up_when_lifted(60.0), "does not lie level"),
    ],
)
def test_what_might_be_one_as_well_as_the_other_is_unclear_with_the_reason(level, lifted, why) -> None:
    found = judged(level, lifted, axes=AS_THE_CHIP)
    assert found.verdict == "unclear" and why in found.says
    assert found.toml == ""


def held(accel, gyro=(0.0, 0.0, 0.0), *, seconds: float = 1.5, noise: float = 0.0) -> Held:
    """The window after so long of a force, and a rate, that are functions of time or constant."""
    rng, window = np.random.default_rng(1), Held()
    for k in range(round(seconds * 100)):
        t_s = k / 100
        a, w = (np.array(f(t_s) if callable(f) else f) for f in (accel, gyro))
        window.add(k * 10_000_000, tuple(a + noise * rng.normal(size=3)), tuple(w))
    return window


G = STANDARD_GRAVITY_M_S2


def test_a_second_of_stillness_gives_the_vertical_and_a_hands_tremor_is_still() -> None:
    up = held((0.0, G * 0.6, G * 0.8), lambda t_s: (0.03 * np.sin(60.0 * t_s), 0.0, 0.0), noise=0.1).up()
    assert up == pytest.approx([0.0, 0.6, 0.8], abs=0.01)


@pytest.mark.parametrize(
    "window",
    [
        Held(),
        held((0.0, 0.0, G), seconds=0.5),
        held((0.0, 0.0, G), noise=0.6),
        held((0.0, 0.0, G), lambda t_s: (0.3 * np.sin(9.0 * t_s), 0.0, 0.0)),
        held(lambda t_s: (G * np.sin(0.1 * t_s), 0.0, G * np.cos(0.1 * t_s))),
        held((0.0, 0.0, 0.0)),
        held((0.0, 0.0, 1.3 * G)),
    ],
    ids=["nothing", "too short", "shaken", "turned to and fro", "leaning over slowly", "falling", "accelerated"],
)
def test_what_is_not_still_gives_no_vertical(window: Held) -> None:
    assert window.up() is None
