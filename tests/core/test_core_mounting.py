"""All ways a chip can lie in a body: words and mathematics come of one table, and no mirror image is let in."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from quavelet.bench.session_words import in_words
from quavelet.calibration.poses import face_up
from quavelet.core.errors import SettingsError
from quavelet.core.instruction import FACES, Instruction
from quavelet.core.mounting import AS_THE_CHIP, called, rotation
from quavelet.settings import MountingSettings

UNIT = {face: (1.0 if face[0] == "+" else -1.0) * np.eye(3)["xyz".index(face[1])] for face in FACES}
TRIPLES = [axes for axes in itertools.product(FACES, repeat=3) if len({face[1] for face in axes}) == 3]


def is_rotation(axes) -> bool:
    return bool(np.linalg.det([UNIT[face] for face in axes]) > 0.0)


ROTATIONS = [axes for axes in TRIPLES if is_rotation(axes)]


def test_there_are_24_mountings_and_the_24_mirror_images_are_refused():
    assert (len(TRIPLES), len(ROTATIONS)) == (48, 24)
    for axes in set(itertools.product(FACES, repeat=3)) - set(ROTATIONS):
        with pytest.raises(ValueError, match="no chip can lie"):
            rotation(axes)
    with pytest.raises(SettingsError, match="'up' is no axis"):
        MountingSettings(z="up")
    with pytest.raises(SettingsError):
        MountingSettings(x="+y", y="+x", z="+z")


@pytest.mark.parametrize("axes", ROTATIONS, ids="".join)
def test_the_face_in_words_is_the_one_that_gravity_shows_in_the_bodys_axes(axes):
    to_body = np.array(rotation(axes))
    assert to_body @ to_body.T == pytest.approx(np.eye(3))
    assert np.linalg.det(to_body) == pytest.approx(1.0)
    for chip_face in FACES:
        # The chip lies with this face up: at rest it shows +g there, and the body shows +g along its own axis.
        body_face = face_up(tuple((9.8 * to_body @ UNIT[chip_face]).tolist()))
        assert called(chip_face, axes) == body_face
        words = in_words(Instruction(action="face", face=chip_face), axes)
        way = "up" if body_face[0] == "+" else "down"
        assert f"{body_face[1].upper()}" in words.replace("Put", "").replace("Lay", "").replace("Let", "")
        assert way in words.split()[-3] or f"points straight {way}" in words or f"Z points {way}" in words
        turn = in_words(Instruction(action="turn", face=chip_face, turn_deg=360.0), axes)
        assert turn.startswith(f"Leave {body_face[1].upper()} pointing {way}.")
        assert "left" in turn


def test_a_chip_that_is_not_turned_keeps_its_names():
    assert rotation(AS_THE_CHIP) == ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    assert [called(face, AS_THE_CHIP) for face in FACES] == list(FACES)
