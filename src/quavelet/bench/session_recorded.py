"""A recording in place of the board: whatever still poses and turns it holds are the evidence."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from quavelet.bench.session_evidence import Chip, Evidence, Move
from quavelet.bench.session_watch import Watch
from quavelet.bench.steps.faces import Poses
from quavelet.bench.steps.lying import Rest
from quavelet.bench.steps.turns import Turns, turn_of
from quavelet.calibration.poses import StillPose
from quavelet.core.blocks import RawBlock

HELD_OUT = 1 / 3
"""So many poses are held out, for the verdict."""
GOLDEN = 0.6180339887
"""Steps by the golden section fall in with no rhythm of the recording."""
PIECE = 4096
SHOWN = (Rest.name, Poses.name, Turns.name)
"""What a recording can show."""


def evidence_of(blocks: Iterable[RawBlock], chip: Chip, *, steps: Collection[str] = SHOWN) -> Evidence:
    """The poses of a recording, any length of one second or more, and the turns between them.

    Nobody says that a face was met exactly: the poses count by their norms alone, so the axes are the sensor's own.
    Whole turns about an axis that was upright are taken as such.
    steps      of SHOWN, those whose part of a calibration is wanted
    """
    evidence, watch = Evidence(chip=chip), Watch(pose_s=1.0, longest_s=10.0)
    n = 0

    def take(poses: Iterable[StillPose], moves: Iterable[Move]) -> None:
        nonlocal n
        for pose in poses:
            n += 1
            used = evidence.poses if Poses.name in steps else evidence.rest
            (evidence.check if GOLDEN * n % 1.0 < HELD_OUT else used).append(pose)
        for move in moves if Turns.name in steps else ():
            found, face = turn_of(move.turned_deg), move.before.face
            upright = found is not None and face is not None and face[1] == "xyz"[found[0]]
            (evidence.told if upright and face == move.after.face else evidence.moves).append(move)

    for block in blocks:
        for begin in range(0, len(block), PIECE):
            seen = watch.seen(block[begin : begin + PIECE])
            take(seen.poses, seen.moves)
    take(*watch.ended())
    evidence.done += [name for name in (Rest.name, Poses.name) if name in steps and (evidence.poses or evidence.rest)]
    return evidence
