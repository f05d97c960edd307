"""OpenTrack's datagram of six doubles."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from sink_messages import message

from quavelet.core.euler import from_euler
from quavelet.sinks.encodings.opentrack import OpenTrack


def test_a_head_that_looks_right_up_and_tilts_right_has_three_positive_angles_behind_three_zeros():
    q = from_euler(np.radians([10.0, -20.0, -30.0])).tolist()  # left side up, nose up, clockwise from above
    datagram = OpenTrack().encode(message(q))
    assert len(datagram) == 48
    assert struct.unpack("<6d", datagram) == pytest.approx((0, 0, 0, 30.0, 20.0, 10.0))


@pytest.mark.parametrize("flag", ["settling", "stuck"])
def test_an_attitude_that_may_not_be_used_is_withheld(flag):
    assert OpenTrack().encode(message(flags=[flag])) == b""
    assert OpenTrack().encode(message(flags=["gap"])) != b""
