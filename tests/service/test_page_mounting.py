"""The mounting check from a chip's registers to the verdict, in the hands of somebody who does what is asked."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from service_bed import Bed

from hw_fakes.world.motion_told import ToldMotion
from quavelet.core.errors import NotPossible
from quavelet.core.mounting import AS_THE_CHIP, Axes, rotation
from quavelet.service.page_mounting import ASK, MountingAbility
from quavelet.settings import BusSettings, MountingSettings, Settings
from quavelet.sinks.message import Message
from quavelet.web.ability import Ability

LEVEL_S, LIFT_S = 6.0, 8.0


def messages(*, true: Axes, said: Axes, lift_deg: float = 40.0, takes_s: float = 1.5) -> list[Message]:
    """Lying with the true body's z up, its front lifted from LIFT_S on."""
    to_body = np.array(rotation(true))
    x, z = to_body[0], to_body[2]
    motion = ToldMotion()
    motion.bring_up(z, at_s=0.0, takes_s=1.0)
    a = np.radians(lift_deg)
    motion.bring_up(np.sin(a) * x + np.cos(a) * z, at_s=LIFT_S, takes_s=takes_s)
    mounting = MountingSettings(x=said[0], y=said[1], z=said[2])
    bed = Bed(motion, settings=Settings(bus=BusSettings(name="fake:bed"), mounting=mounting))
    bed.run(until_s=LIFT_S + takes_s + 3.0)
    return bed.messages


def checked(came: list[Message], said: Axes) -> MountingAbility:
    """After "start" at once and "next" at LEVEL_S, all that came."""
    ability = MountingAbility(said)
    ability.do("start", {})
    for message in came:
        if message.t_ns >= LEVEL_S * 1e9 and ability.state().step == "level":
            assert ability.do("next", {}) == ASK["nose_up"]
        ability.see(message)
    return ability


@pytest.mark.parametrize(
    ("true", "said"),
    [
        (AS_THE_CHIP, AS_THE_CHIP),
        (("+y", "-x", "+z"), AS_THE_CHIP),
        (AS_THE_CHIP, ("-x", "+y", "-z")),
        (("+z", "+x", "+y"), ("-y", "+z", "-x")),
    ],
)
def test_the_verdict_is_given_as_soon_as_the_lifted_pose_is_held(true: Axes, said: Axes) -> None:
    ability = checked(messages(true=true, said=said), said)
    state = ability.state()
    assert (state.step, state.ask) == ("done", "")
    if true == said:
        assert (state.verdict, state.toml) == ("right", "")
    else:
        assert state.verdict == "wrong"
        assert state.toml == '[mounting]\nx = "{}"\ny = "{}"\nz = "{}"\n'.format(*true)
    assert ability.about() == {"axes": {"x": said[0], "y": said[1], "z": said[2]}}


def test_too_small_a_tilt_waits_and_is_unclear_only_when_gone_on_from() -> None:
    ability = checked(messages(true=AS_THE_CHIP, said=AS_THE_CHIP, lift_deg=8.0), AS_THE_CHIP)
    assert (ability.state().step, ability.state().verdict) == ("nose_up", "")
    says = ability.do("next", {})
    assert "8 degrees only" in says
    assert ability.state().verdict == "unclear" and ability.state().says == says


def test_a_hand_that_still_moves_is_unclear_when_gone_on_from() -> None:
    came = messages(true=AS_THE_CHIP, said=AS_THE_CHIP, takes_s=20.0, lift_deg=60.0)
    moving = [message for message in came if message.t_ns < (LIFT_S + 8.0) * 1e9]
    ability = checked(moving, AS_THE_CHIP)
    assert "not held still" in ability.do("next", {})
    assert ability.state().verdict == "unclear"


def test_nothing_goes_on_before_it_lies_still_or_without_a_chip() -> None:
    ability: Ability = MountingAbility(AS_THE_CHIP)
    assert ability.name == "mounting"
    with pytest.raises(NotPossible, match="begin with start"):
        ability.do("next", {})
    ability.do("start", {})
    with pytest.raises(NotPossible, match="not still"):
        ability.do("next", {})
    assert ability.state().step == "level"  # type: ignore[attr-defined]
    assert "ended" in ability.do("stop", {})
    assert ability.state().step == "idle"  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match='"start"'):
        ability.do("jump", {})


def test_a_gap_or_a_stuck_chip_is_not_taken_for_stillness() -> None:
    came = [m for m in messages(true=AS_THE_CHIP, said=AS_THE_CHIP) if m.t_ns < LEVEL_S * 1e9][-120:]
    ability = MountingAbility(AS_THE_CHIP)
    ability.do("start", {})
    for k, message in enumerate(came):
        ability.see(message if k != len(came) - 30 else spoilt(message))
    with pytest.raises(NotPossible, match="not still"):
        ability.do("next", {})


def spoilt(message: Message) -> Message:
    return msgspec.structs.replace(message, flags=["stuck"])
