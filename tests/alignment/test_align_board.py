"""A board's samples as they come: the longest stillness, and what is said of heading."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quavelet.alignment.board import align_board, longest_still
from quavelet.alignment.result import Heading
from quavelet.alignment.sensors import MPU6050
from quavelet.core.blocks import Flag, ImuBlock
from quavelet.core.euler import to_euler

G = 9.80665


def samples(still: list[bool], *, flags: list[int] | None = None) -> ImuBlock:
    """At 10 Hz; the temperature numbers them."""
    n = len(still)
    return ImuBlock(
        t_ns=np.arange(1, n + 1) * 100_000_000,
        period_s=np.full(n, 0.1),
        gap_ns=np.zeros(n, dtype=np.int64),
        flags=np.array(flags or [0] * n, dtype=np.uint32),
        gyro_rad_s=np.zeros((n, 3)),
        accel_m_s2=np.tile([0.0, 0.0, G], (n, 1)),
        temp_degc=np.arange(n, dtype=np.float64),
        gyro_bias_rad_s=np.zeros((n, 3)),
        still=np.array(still, dtype=np.bool_),
    )


def test_the_longest_stretch_is_taken():
    found = longest_still([samples([False, True, True, False, True, True, True, False, True])])
    assert found.block is not None
    assert found.block.temp_degc.tolist() == [4.0, 5.0, 6.0]
    assert (found.still_s, found.all_s) == (pytest.approx(0.3), pytest.approx(0.9))


@given(st.lists(st.booleans(), min_size=1, max_size=40), st.lists(st.integers(0, 40), max_size=6))
def test_pieces_give_the_same_stretch(still, cuts):
    whole = samples(still)
    edges = [0, *sorted(min(cut, len(still)) for cut in cuts), len(still)]
    in_pieces = longest_still(whole[a:b] for a, b in pairwise(edges))
    at_once = longest_still([whole])
    if at_once.block is None:
        assert in_pieces.block is None
    else:
        assert in_pieces.block is not None
        assert in_pieces.block.temp_degc.tolist() == at_once.block.temp_degc.tolist()


@pytest.mark.parametrize("flag", [Flag.GAP, Flag.ACCEL_CLIPPED, Flag.STUCK])
def test_a_spoilt_sample_ends_a_stretch(flag):
    found = longest_still([samples([True] * 5, flags=[0, 0, int(flag), 0, 0])])
    assert found.block is not None
    assert found.block.temp_degc.tolist() == [0.0, 1.0]
    assert found.stuck == (flag is Flag.STUCK)


def test_a_recording_of_a_day_is_not_read_to_its_end():
    def for_ever():
        for _ in range(100):
            yield samples([True] * 100)
        raise AssertionError("read on")

    assert longest_still(for_ever(), enough_s=55.0).still_s == pytest.approx(60.0)


def test_no_samples_are_no_stillness():
    found = longest_still([])
    assert (found.block, found.still_s, found.stuck) == (None, 0.0, False)


def test_heading_of_an_mpu6050_is_refused_with_the_places_own_figures():
    still = samples([True] * 50)
    anywhere, here = (
        align_board(still, errors=MPU6050, latitude_rad=latitude) for latitude in (None, np.radians(60.0))
    )
    assert {anywhere.heading, here.heading} == {Heading.EARTH_RATE_HIDDEN}
    assert "even at the equator heading would be anywhere: 0.01 deg/s" in anywhere.reason
    assert "0.01 deg/s of gyroscope error in 0.0021 deg/s of horizontal earth rate" in here.reason
    assert to_euler(here.q) == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)


def test_a_better_gyroscope_has_lost_the_earths_rate_at_this_rest():
    """Its bias was measured there: heading from what is left would be noise."""
    found = align_board(samples([True] * 50), errors=replace(MPU6050, gyro_bias_rad_s=1e-7), latitude_rad=0.5)
    assert found.heading is Heading.NO_REFERENCE


def test_a_magnetometer_gives_the_heading_that_the_gyroscope_cannot():
    field_ut = np.full((50, 3), np.nan)
    # Level and turned by 90 deg clockwise, magnetic north is on the left.
    field_ut[::10] = [-20.0, 0.0, -40.0]
    still = samples([True] * 50)
    found = align_board(still, errors=MPU6050, field_ut=field_ut, declination_rad=np.radians(3.0))
    assert found.heading is Heading.OBSERVED
    assert np.degrees(to_euler(found.q, order="zxy")) == pytest.approx([0.0, 0.0, 93.0], abs=1e-9)
    silent = align_board(still, errors=MPU6050, field_ut=np.full((50, 3), np.nan))
    assert silent.heading is Heading.EARTH_RATE_HIDDEN
