"""The step in which the board is turned by a known angle about each of its axes, one way and back."""

from __future__ import annotations

import numpy as np

from quavelet.bench.session_evidence import Move
from quavelet.bench.session_watch import STILL_S, Seen
from quavelet.bench.steps.lying import beyond_sheet
from quavelet.bench.steps.step import Step
from quavelet.calibration.model import Vector
from quavelet.core.blocks import Flag
from quavelet.core.instruction import Instruction

WHOLE_TURN_DEG = 360.0
TURN_FACES = ("+z", "+x", "+y")
WAYS = (1, -1)
WITHIN = 0.10
"""A turn is by whole circles where the angle is so near to one: 3 % of scale, and 2 % of other axes' rates."""


LOST_TURN = "samples were lost in that turn: look at its plug and wires, and make it once more"
SLOW_TURN = "that took longer than 40 s: turn it within some five to twenty seconds"


class Turns(Step):
    """A whole turn each way about x, y and z, on a table, from an edge back to it; recognised whichever is done."""

    name = "turns"
    title = "Whole turns"

    @property
    def missing(self) -> tuple[tuple[str, int], ...]:
        """(face that is up, +1 counter-clockwise or -1) of each turn that was not made yet."""
        have = {found for move in self.evidence.told if (found := turn_of(move.turned_deg))}
        wanted = [("xyz".index(face[1]), way) for face in TURN_FACES for way in WAYS]
        return tuple(("+" + "xyz"[axis], way) for axis, way in wanted if (axis, way) not in have)

    @property
    def instruction(self) -> Instruction:
        face, way = (self.missing or ((TURN_FACES[0], 1),))[0]
        if self._up != face:
            return Instruction(action="face", face=face)
        return Instruction(action="turn", face=face, turn_deg=way * WHOLE_TURN_DEG)

    _lost = False
    _moved = False
    """Since the last pose."""
    _up: str | None = None
    """The face that lies measured, from which a turn can begin."""

    @property
    def progress(self) -> float:
        return 1.0 - len(self.missing) / (len(TURN_FACES) * len(WAYS))

    @property
    def status(self) -> str:
        wanted = len(TURN_FACES) * len(WAYS)
        return f"{wanted - len(self.missing)} of {wanted}"

    @property
    def needs_s(self) -> float:
        return STILL_S

    def take(self, seen: Seen) -> None:
        if hot := beyond_sheet(seen):
            self.notice = hot
            return
        self._lost = self._lost or seen.lost
        self._moved = self._moved or seen.still_s == 0.0
        for move in seen.moves:
            self._judge(move)
        if seen.poses and not seen.moves and self._moved and self._up is not None:
            self.notice = LOST_TURN if self._lost else SLOW_TURN
            self.asks += 1
        if seen.poses:
            self._lost = self._moved = False
        for pose in seen.poses:
            self._up = pose.face
        if (seen.raw.flags & Flag.GYRO_CLIPPED).any():
            self.notice = "that was faster than the range: turn it slower, a whole turn in some five seconds"

    def _judge(self, move: Move) -> None:
        """Takes it for a turn that was asked for, for a change of face, or refuses it with the reason."""
        if (move.rows(self.evidence.chip.scale).flags & Flag.GYRO_CLIPPED).any():
            self._up = None
            return
        turned, found = np.array(move.turned_deg), turn_of(move.turned_deg)
        missing = {("xyz".index(face[1]), way) for face, way in self.missing}
        if found in missing:
            self.evidence.told.append(move)
            self.asks += 1
            self.notice = ""
        elif found is not None:
            self.notice = (
                f"that turn about {self.called('+' + 'xyz'[found[0]])[1]} is measured: the next is the one asked for"
            )
            self.asks += 1
        elif move.before.face == move.after.face and np.abs(turned).max() > 20.0:
            self.notice = f"that was {np.abs(turned).max():.0f} degrees: turn it a whole turn, from the edge back to it"
            self.asks += 1
        else:
            self.evidence.moves.append(move)


def turn_of(turned_deg: Vector) -> tuple[int, int] | None:
    """(axis, +1 or -1) of angles that are one whole turn about one axis; None for any other."""
    sizes = [abs(angle) for angle in turned_deg]
    axis = sizes.index(max(sizes))
    across = max(sizes[:axis] + sizes[axis + 1 :])
    if max(abs(sizes[axis] - WHOLE_TURN_DEG), across) > WITHIN * WHOLE_TURN_DEG:
        return None
    return axis, 1 if turned_deg[axis] > 0 else -1
