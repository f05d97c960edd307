"""The panel tells a fake from a chip, shows doubt, and fits an old terminal."""

import math

from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from quavelet.cli.panel import Status, render
from quavelet.core.blocks import Flag
from quavelet.core.health import Health
from quavelet.loop.deadline import LoopStats
from quavelet.sinks.message import Message

ANGLE = st.floats(-180.0, 180.0)
SIGMA = st.floats(0.0, 999.99)
RATE = st.floats(-35.0, 35.0)
FORCE = st.floats(-160.0, 160.0)
COUNT = st.integers(0, 10**9)
MESSAGES = st.builds(
    Message,
    t_ns=COUNT,
    q=st.just((1.0, 0.0, 0.0, 0.0)),
    roll_deg=ANGLE,
    pitch_deg=ANGLE,
    yaw_deg=ANGLE,
    yaw=st.sampled_from(["relative", "magnetic", "true"]),
    sigma_deg=st.tuples(SIGMA, SIGMA, SIGMA),
    gyro_rad_s=st.tuples(RATE, RATE, RATE),
    accel_m_s2=st.tuples(FORCE, FORCE, FORCE),
    temp_degc=st.floats(-60.0, 140.0),
    gyro_bias_rad_s=st.just((0.0, 0.0, 0.0)),
    still=st.booleans(),
    flags=st.lists(st.sampled_from(Flag.names(~0 & 0xFFFF)), unique=True),
    gap_ns=COUNT,
    delay_ns=COUNT,
    src=st.sampled_from(["linux:1", "fake:tilt", "replay:fake:tilt", "fake:counts:" + "/folder" * 20 + "/file.npz"]),
)
STATUSES = st.builds(
    Status,
    rate_hz=st.none() | st.floats(1.0, 1010.0),
    health=st.builds(Health, samples=COUNT, samples_lost=COUNT, gaps=COUNT),
    loop=st.none() | st.builds(LoopStats, *[COUNT] * 8),
)


def shown(message: Message, status: Status, *, width: int = 80) -> list[str]:
    console = Console(width=width, color_system=None, force_terminal=True)
    with console.capture() as capture:
        console.print(render(message, status))
    return capture.get().splitlines()


@given(MESSAGES, STATUSES)
def test_it_never_leaves_80_columns_nor_breaks_a_row(message: Message, status: Status) -> None:
    lines = shown(message, status)
    assert {len(line) for line in lines} == {80}
    for row in ("roll  about x", "pitch about y", f"yaw   about z ({message.yaw})"):
        (line,) = [line for line in lines if row in line]
        assert "°  ± " in line
        assert "█" in line
        assert "…" not in line
    flag_rows = math.ceil(len(", ".join(message.flags)) / 60)
    assert len(lines) <= 12 + max(1, flag_rows)


@given(MESSAGES, STATUSES)
def test_a_fake_is_called_one_and_a_chip_is_not(message: Message, status: Status) -> None:
    assert ("NOT A REAL CHIP" in shown(message, status)[0]) == ("fake:" in message.src)


@given(MESSAGES, STATUSES)
def test_every_flag_every_sigma_and_the_losses_are_shown(message: Message, status: Status) -> None:
    text = "\n".join(shown(message, status))
    assert [flag for flag in message.flags if flag not in text] == []
    assert ("all well" in text) == (not message.flags)
    assert all(f"± {sigma:6.2f}°" in text for sigma in message.sigma_deg)
    assert f"{status.health.samples_lost} of " in text


@given(MESSAGES, STATUSES, st.integers(20, 79))
def test_a_narrow_terminal_is_not_overrun(message: Message, status: Status, width: int) -> None:
    assert max(map(len, shown(message, status, width=width))) <= width
