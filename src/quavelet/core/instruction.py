"""What somebody at a bench can be asked to do with a board: data, that a person is told in words and a fake obeys."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Action = Literal["rest", "face", "turn", "pose", "warm", "swing"]

FACES = ("+z", "-z", "+x", "-x", "+y", "-y")
"""Which body axis points up, in the order a person is asked for them: at rest the accelerometer reads +g along it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Instruction:
    """One thing to do.

    action     rest: leave the board lying as it is. face: put it down with `face` up. turn: with `face` up already,
               turn it about the vertical by `turn_deg`, counter-clockwise from above. pose: hold it in any attitude
               that it was not held in before. warm: warm it, then let it cool, lying. swing: turn it slowly through
               all attitudes
    """

    action: Action
    face: str = ""
    turn_deg: float = 0.0

    def __post_init__(self) -> None:
        if (self.action in ("face", "turn")) != (self.face in FACES):
            raise ValueError(f"to {self.action} with face {self.face!r} makes no sense: faces are {', '.join(FACES)}")
