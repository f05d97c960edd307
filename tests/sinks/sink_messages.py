"""Messages for the tests of encodings: any attitude, any flags, and what may be wrong in them."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from hypothesis import strategies as st

from quavelet.core.blocks import Flag
from quavelet.core.euler import to_euler
from quavelet.core.quaternion import normalise
from quavelet.core.units import DEG_PER_RAD
from quavelet.sinks.message import Message, Yaw

FLAGS = [str(flag.name).lower() for flag in Flag]
T_NS = 90_061_123_456_789
"""25 hours, 1 minute, 1.123456789 s after boot."""
OFFSET_NS = 1_700_000_000_000_000_000 - T_NS
"""So that T_NS is 2023-11-14 22:13:20 UTC."""


def offset_ns() -> int:
    return OFFSET_NS


def message(
    q: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
    *,
    yaw: Yaw = "relative",
    flags: Sequence[str] = (),
    gyro_rad_s: Sequence[float] = (0.0, 0.0, 0.0),
    sigma_deg: Sequence[float] = (0.5, 0.5, 2.0),
    t_ns: int = T_NS,
    src: str = "linux:1",
) -> Message:
    """A message whose angles are those of `q`."""
    unit = normalise(np.array(q, dtype=np.float64))
    angles = (DEG_PER_RAD * to_euler(unit)).tolist()
    return Message(
        t_ns=t_ns,
        q=tuple(unit.tolist()),
        roll_deg=angles[0],
        pitch_deg=angles[1],
        yaw_deg=angles[2],
        yaw=yaw,
        sigma_deg=tuple(sigma_deg),
        gyro_rad_s=tuple(gyro_rad_s),
        accel_m_s2=(0.1, -0.2, 9.8),
        temp_degc=31.25,
        gyro_bias_rad_s=(0.01, -0.02, 0.03),
        still=False,
        flags=list(flags),
        gap_ns=0,
        delay_ns=5_000_000,
        src=src,
    )


_component = st.floats(-1.0, 1.0)
quaternions = (
    st.tuples(_component, _component, _component, _component)
    .filter(lambda q: sum(c * c for c in q) > 1e-3)
)  # fmt: skip
rates = st.tuples(*[st.floats(-34.9, 34.9)] * 3)
"""rad/s, up to the chip's largest range of 2000 deg/s."""
yaws: st.SearchStrategy[Yaw] = st.sampled_from(["relative", "magnetic", "true"])
flags = st.lists(st.sampled_from(FLAGS), unique=True, max_size=4)
sources = st.one_of(st.text(max_size=60), st.sampled_from(["linux:1", "fake:tilt", "a,b=c d\\", "x\r\n$GPGGA,1*00"]))
messages = st.builds(message, quaternions, yaw=yaws, flags=flags, gyro_rad_s=rates, src=sources)

_no_number = st.sampled_from([float("nan"), float("inf"), float("-inf")])
_PLACES = ["q", "roll_deg", "pitch_deg", "yaw_deg", "sigma_deg", "gyro_rad_s", "accel_m_s2", "temp_degc"]


@st.composite
def broken_messages(draw: st.DrawFn) -> Message:
    """A message with something in it that is no number."""
    whole, place, bad = draw(messages), draw(st.sampled_from(_PLACES)), draw(_no_number)
    value = getattr(whole, place)
    return msgspec.structs.replace(whole, **{place: (bad, *value[1:]) if isinstance(value, tuple) else bad})
