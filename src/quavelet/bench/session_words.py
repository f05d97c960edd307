"""The instructions in words, from the same table of faces as the mathematics and the live check."""

from __future__ import annotations

from quavelet.core.instruction import Instruction
from quavelet.core.mounting import AS_THE_CHIP, Axes, called

_WAY = {"+": "up", "-": "down"}
_LEFT, _RIGHT = "left (counter-clockwise from above)", "right (clockwise from above)"


def in_words(instruction: Instruction, axes: Axes = AS_THE_CHIP) -> str:
    """What a person is to do, as one sentence. The instruction is in the chip's axes, the words are in those of the
    body in which it is mounted so."""
    face = called(instruction.face, axes) if instruction.face else ""
    match instruction.action:
        case "rest":
            return "Leave the board lying still on the table, and let go of it and its cable."
        case "face":
            return f"{_put(face, axes)} Let go."
        case "turn":
            axis, way = face[1].upper(), _WAY[face[0]]
            if abs(instruction.turn_deg) < 360.0:
                return f"Leave {axis} pointing {way}, and turn the board half round on the table. Let go."
            turn = _LEFT if instruction.turn_deg > 0 else _RIGHT
            return (
                f"Leave {axis} pointing {way}. Hold the board to a straight edge, turn it once all the way round to "
                f"the {turn}, in five seconds or more, back to the edge. Let go."
            )
        case "pose":
            return "Lean it against something, or hold it quite still, in an attitude it was not in before."
        case "warm":
            return (
                "Warm it by 15 degC or more, with a hair dryer from afar or a warm hand. Then leave it lying while it "
                "cools."
            )
        case "swing":
            return "Turn it slowly through all attitudes, each axis up and down once, away from iron and cables."


def _put(face: str, axes: Axes) -> str:
    axis, way = face[1].upper(), _WAY[face[0]]
    if axes != AS_THE_CHIP:
        return f"Put it down so that its {axis} axis, as it is mounted, points straight {way}."
    if axis == "Z":
        side = "on top" if face[0] == "+" else "below"
        return f"Lay it flat with the chip {side}: Z points {way}."
    return f"Stand it on edge so that the arrow printed {axis} points straight {way}."
