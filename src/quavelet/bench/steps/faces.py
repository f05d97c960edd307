"""The steps in which the board is put somewhere and let go: six faces, any poses, and those for the verdict."""

from __future__ import annotations

import numpy as np

from quavelet.bench.session_evidence import Move
from quavelet.bench.session_watch import STILL_S, Seen
from quavelet.bench.steps.lying import beyond_sheet
from quavelet.bench.steps.step import Step
from quavelet.calibration.poses import StillPose
from quavelet.core.blocks import FloatArray
from quavelet.core.instruction import FACES, Instruction

TIMES = 2
HALF_TURN_DEG = 180.0
HALF_WITHIN_DEG = 45.0
APART_DEG = 20.0
HELD_POSES = 12
CHECK_POSES = 4


class Faces(Step):
    """Each of the six faces twice, the second time turned half round: a table that leans does so both ways.

    Any order will do: whichever is up is recognised.
    """

    name = "faces"
    title = "Six faces"

    _up: str | None = None
    """The face that lies measured."""

    @property
    def missing(self) -> tuple[str, ...]:
        """Faces that are not measured twice yet, in the order they are asked for."""
        have = [pose.face for pose in self.evidence.placed]
        return tuple(face for face in FACES if have.count(face) < TIMES)

    @property
    def instruction(self) -> Instruction:
        missing = self.missing or FACES
        if self._up in missing:
            return Instruction(action="turn", face=self._up, turn_deg=HALF_TURN_DEG)
        return Instruction(action="face", face=missing[0])

    @property
    def progress(self) -> float:
        return len(self.evidence.placed) / (TIMES * len(FACES))

    @property
    def status(self) -> str:
        return f"missing: {' '.join(map(self.called, self.missing))}" if self.missing else "all six"

    @property
    def needs_s(self) -> float:
        return STILL_S

    def take(self, seen: Seen) -> None:
        if hot := beyond_sheet(seen):
            self.notice = hot
            return
        if seen.still_s == 0.0:
            self.notice = ""
        self.evidence.moves += seen.moves
        for pose in seen.poses:
            self._judge(pose, next((move for move in seen.moves if move.after == pose), None))

    def _judge(self, pose: StillPose, move: Move | None) -> None:
        """Takes a pose for a face, or refuses it with the reason. `move` led to it; None where it lay so before."""
        face, before = pose.face, self._up
        self._up = face
        if face is None:
            self.notice = "it lies on no face: put it flat on one, against something square"
        elif face not in self.missing:
            if self.missing:
                self.notice = f"{self.called(face)} is measured: the next is {self.called(self.missing[0])}"
        elif any(other.face == face for other in self.evidence.placed) and not _turned(move, face):
            if before != face or move is not None:  # else it lies there, and nobody has done anything yet
                self.notice = f"{self.called(face)} is measured that way round: turn it half round on the table"
        else:
            self.evidence.placed.append(pose)
            self.notice = ""
            return
        self.ask_again(moved=move is not None)


def _turned(move: Move | None, face: str) -> bool:
    """Whether a face lies another way round than before the move: half round, or put there anew from another."""
    if move is None:
        return False
    angle = abs(move.turned_deg["xyz".index(face[1])])
    return move.before.face != face or abs(angle - HALF_TURN_DEG) < HALF_WITHIN_DEG


class _Held(Step):
    """So many poses in directions that differ."""

    wanted: int

    def _have(self) -> list[StillPose]:
        raise NotImplementedError

    @property
    def instruction(self) -> Instruction:
        return Instruction(action="pose")

    @property
    def progress(self) -> float:
        return min(1.0, len(self._have()) / self.wanted)

    @property
    def status(self) -> str:
        return f"{len(self._have())} of {self.wanted}"

    @property
    def needs_s(self) -> float:
        return STILL_S

    def take(self, seen: Seen) -> None:
        if hot := beyond_sheet(seen):
            self.notice = hot
            return
        if seen.still_s == 0.0:
            self.notice = ""
        for pose in seen.poses:
            if any(_away_deg(pose, other) < APART_DEG for other in self._others()):
                self.notice = "it was held so before: lean it another way, by 20 degrees or more"
                self.ask_again(moved=bool(seen.moves))
            elif self.progress < 1.0:
                self._have().append(pose)
                self.ask_again(moved=True)
                self.notice = ""

    def _others(self) -> list[StillPose]:
        return self._have()


class Poses(_Held):
    """Held or leant in many attitudes: the accelerometer without six exact faces."""

    name = "poses"
    title = "Poses by hand"
    wanted = HELD_POSES

    def _have(self) -> list[StillPose]:
        return self.evidence.poses

    def take(self, seen: Seen) -> None:
        super().take(seen)
        if self.progress < 1.0 or seen.poses:
            self.evidence.moves += seen.moves


class Check(_Held):
    """Poses that no fit sees: by them the verdict is made."""

    name = "check"
    title = "Check"
    wanted = CHECK_POSES

    def _have(self) -> list[StillPose]:
        return self.evidence.check

    def _others(self) -> list[StillPose]:
        return [*self.evidence.check, *self.evidence.placed]


def _away_deg(a: StillPose, b: StillPose) -> float:
    u, v = (_unit(pose) for pose in (a, b))
    return float(np.degrees(np.arccos(np.clip(u @ v, -1.0, 1.0))))


def _unit(pose: StillPose) -> FloatArray:
    force = np.array(pose.accel_m_s2)
    unit: FloatArray = force / np.linalg.norm(force)
    return unit
