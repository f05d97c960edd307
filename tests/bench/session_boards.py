"""The whole guided session on boards drawn from the data sheet's limits, against their truth, and what the verdict says
of them: `python tests/bench/session_boards.py [BOARDS [SPOILT]]`."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
from session_rig import Bench

from hw_fakes.world.imperfections import Imperfections
from quavelet.bench.session import USUAL
from quavelet.bench.session_evidence import Evidence
from quavelet.bench.session_result import Result, work_out
from quavelet.bench.session_verdict import verdict
from quavelet.calibration.poses import StillPose, vector
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

sys.path.append(str(Path(__file__).resolve().parents[1] / "calibration"))
from boards_table import BARS, Errors, errors_of, show
from simulated_boards import Calibrated

LOOKS_HZ = 6.0
"""As seldom as the FIFO allows: nobody watches."""
FIRST = 100


@dataclass(frozen=True)
class Judged:
    """What a session made of one board: its errors, and what the verdict found not good enough."""

    errors: Errors
    refused: tuple[str, ...]

    @property
    def good(self) -> bool:
        """Every error of the board is within the bar."""
        return all(self.errors[0][name] <= bar for name, bar in BARS.items())


def measured(seed: int, folder: Path) -> tuple[Evidence, Imperfections]:
    """The evidence of one board that was led through the usual steps, and its truth."""
    bench = Bench(USUAL, out=folder / f"{seed}", seed=seed)
    assert bench.conduct(looks_hz=LOOKS_HZ)
    return bench.evidence, bench.bus.sensor


def judged(evidence: Evidence, truth: Imperfections, since: Spoilt | None = None) -> Judged:
    """`since`: what the session was spoilt by; what moved since it was measured is an error of the calibration."""
    result = work_out(evidence, utc="2026-01-01T00:00:00Z", version="0")
    errors = errors_of(_fits(result, truth))
    if since is not None:
        errors[0]["accelerometer offset, mg"] += since.zero_mg
        errors[0]["gyroscope bias, deg/s"] += since.bias_dps
    return Judged(errors, tuple(finding.name for finding in verdict(result) if not finding.ok))


def _fits(result: Result, truth: Imperfections) -> Calibrated:
    assert result.accel is not None and result.bias is not None and result.turns is not None, result.refused
    return Calibrated(truth, [], 0, result.accel, result.bias, result.turns)


@dataclass(frozen=True)
class Spoilt:
    """One way in which a session goes wrong that no step sees."""

    name: str
    spoil: Callable[[Evidence, np.random.Generator], None]
    zero_mg: float = 0.0
    bias_dps: float = 0.0


def _leaning(pose: StillPose, rad: np.ndarray) -> StillPose:
    force = np.array(pose.accel_m_s2)
    return replace(pose, accel_m_s2=vector(force + np.cross(rad, force)))


def _on_a_crumb(evidence: Evidence, rng: np.random.Generator) -> None:
    evidence.placed[4] = _leaning(evidence.placed[4], 3.0 * RAD_PER_DEG * _way(rng))


def _carelessly(evidence: Evidence, rng: np.random.Generator) -> None:
    evidence.placed = [_leaning(pose, RAD_PER_DEG * rng.normal(0.0, 1.0, 3)) for pose in evidence.placed]


def _on_a_slope(evidence: Evidence, rng: np.random.Generator) -> None:
    """Turned half round the second time, so that the board leans the other way."""
    lean = np.zeros(3)
    for k, pose in enumerate(evidence.placed):
        lean = -lean if k % 2 else 0.5 * RAD_PER_DEG * _way(rng)
        evidence.placed[k] = _leaning(pose, lean)


def _on_a_bent_board(evidence: Evidence, rng: np.random.Generator) -> None:
    """The same lean of one face both times: an edge that is not square."""
    lean = 1.5 * RAD_PER_DEG * _way(rng)
    evidence.placed = [_leaning(p, lean) if p.face in ("+x", "-x") else p for p in evidence.placed]


def _too_far(evidence: Evidence, _rng: np.random.Generator) -> None:
    for k in (0, 1):
        move = evidence.told[k]
        counts = np.frombuffer(move.counts, dtype=np.int16).reshape(-1, 7).copy()
        counts[:, 4:7] = np.round(counts[:, 4:7] * 370.0 / 360.0)
        evidence.told[k] = msgspec.structs.replace(move, counts=counts.tobytes())


def _bias_moves(evidence: Evidence, _rng: np.random.Generator) -> None:
    evidence.check = [
        replace(p, gyro_rad_s=(p.gyro_rad_s[0] + 0.1 * RAD_PER_DEG, *p.gyro_rad_s[1:])) for p in evidence.check
    ]


def _zero_moves(evidence: Evidence, rng: np.random.Generator) -> None:
    shift = 0.02 * STANDARD_GRAVITY_M_S2 * _way(rng)
    evidence.check = [replace(p, accel_m_s2=vector(np.array(p.accel_m_s2) + shift)) for p in evidence.check]


def _way(rng: np.random.Generator) -> np.ndarray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


SPOILT = (
    Spoilt("a table that leans by 0.5 deg", _on_a_slope),
    Spoilt("one face on a crumb, 3 deg", _on_a_crumb),
    Spoilt("put down within 1 deg only", _carelessly),
    Spoilt("an edge 1.5 deg off square", _on_a_bent_board),
    Spoilt("two turns 10 deg too far", _too_far),
    Spoilt("bias moves 0.1 deg/s meanwhile", _bias_moves, bias_dps=0.1),
    Spoilt("zero moves 20 mg meanwhile", _zero_moves, zero_mg=20.0),
)


@dataclass(frozen=True)
class Table:
    """95 % points and coverage as `show` gives them, and each board as it was judged: well measured, and spoilt."""

    points: dict[str, float]
    covered: dict[str, float]
    well: list[Judged]
    spoilt: dict[str, list[Judged]]


def table(seeds: Iterable[int], folder: Path, *, spoil: int) -> Table:
    """Each board as it was measured, and `spoil` of them as they would have been with each thing that goes wrong;
    printed."""
    well: list[Judged] = []
    spoilt: dict[str, list[Judged]] = {kind.name: [] for kind in SPOILT}
    for seed in seeds:
        evidence, truth = measured(seed, folder)
        well.append(judged(evidence, truth))
        kept = msgspec.msgpack.encode(evidence)
        for kind in SPOILT if len(well) <= spoil else ():
            copy = msgspec.msgpack.decode(kept, type=Evidence)
            kind.spoil(copy, np.random.default_rng([7, seed]))
            spoilt[kind.name].append(judged(copy, truth, kind))
    points, covered = show([one.errors for one in well], "led through the whole session")
    print(f"\n{'the verdict':<38}{'good':>8}{'refused':>9}{'bad':>8}{'let pass':>10}")
    for name, boards in {"as it should be": well, **spoilt}.items():
        good = [bool(one.refused) for one in boards if one.good]
        bad = [not one.refused for one in boards if not one.good]
        print(f"{name:<38}{len(good):>8}{sum(good):>9}{len(bad):>8}{sum(bad):>10}")
    return Table(points, covered, well, spoilt)


if __name__ == "__main__":
    said = [int(one) for one in sys.argv[1:]]
    boards, spoil = [*said, 200, 40][:1] + [*said[1:], 40][:1]
    with tempfile.TemporaryDirectory() as place:
        table(range(FIRST, FIRST + boards), Path(place), spoil=spoil)
