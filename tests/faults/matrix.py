"""Every fault in every state of the driver: what becomes of it, how soon it is noticed, how soon samples come again.

`python tests/faults/matrix.py` prints the table as Markdown, with `--short` the worst of each kind.
"""

from __future__ import annotations

import copy
import logging
import sys
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise

import numpy as np
from in_self_test import self_test_cell, summed_up

from hw_fakes import NOISE_ONLY, FakeBus, FakeDataReady, FakeMpu6050, Tilt
from hw_fakes.faults.of_wires import CutWrite, FlippedWrite, TimedOut
from hw_fakes.faults.plan import parse
from quavelet.cli.exits import exit_code
from quavelet.core.blocks import AttitudeBlock, Flag
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import ImuError
from quavelet.core.health import Health
from quavelet.core.quaternion import inclination_between
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050.source import ChipSource
from quavelet.mpu6050.startup import Step
from quavelet.pipeline import build_pipeline
from quavelet.settings import Settings

STATES = ("reset", "configure", "start", "streaming", "brought back")
"""In the first start-up its three steps; while samples come; while a chip that lost its supply is configured anew. The
sixth, while the self-test measures, is in in_self_test.py."""

KINDS: dict[str, tuple[str, ...]] = {
    "no acknowledge": ("nack", "nack n=12", "nack for=0.05", "nack for=5"),
    "time-out": ("time-out takes=0.02", "time-out takes=1", "time-out takes=0.02 n=8"),
    "EIO": ("eio", "eio n=12", "eio for=0.05"),
    "lost arbitration": ("arbitration", "arbitration n=12"),
    "flipped bit, read": (
        "flip register=0x74 byte=8 bit=6",
        "flip register=0x74 byte=2 bit=6",
        "flip register=0x74 byte=6 bit=4",
        "flip register=0x72 bit=1",
        "flip register=0x73 bit=2",
        "flip register=0x3a bit=4",
        "flip register=0x75 bit=3",
        "flip register=0x6b bit=6",
        "flip for=0.3 register=0x73",
    ),
    "flipped bit, written": tuple(
        f"flip-write register={r}" for r in ("0x19", "0x1a", "0x1b", "0x1c", "0x23", "0x6a", "0x6b")
    ),
    "cut write": ("cut-write", "cut-write n=12"),
    "torn frame": ("torn", "torn lost=3", "torn lost=14"),
    "garbage": ("garbage", "garbage n=12"),
    "supply dips": ("brown-out",),
    "falls asleep": ("asleep",),
    "register changes": (
        "changed register=0x19 value=9",
        "changed register=0x1a value=0",
        "changed register=0x1b value=0x18",
        "changed register=0x1c value=0",
        "changed register=0x23 value=0",
        "changed register=0x37 value=0x10",
        "changed register=0x38 value=0xff",
        "changed register=0x6a value=0",
        "changed register=0x6b value=0x41",
        "changed register=0x6c value=0x07",
    ),
    "FIFO slips": tuple(f"slip bytes={n}" for n in (*range(1, 14), -1)),
    "FIFO overflows": ("overflow",),
    "data frozen": ("frozen for=3",),
    "wrong temperature": ("temperature by=30 for=1",),
    "lines at 0x00": ("zeros", "zeros for=0.3", "zeros for=5"),
    "lines at 0xFF": ("ones", "ones for=0.3", "ones for=5"),
    "interrupts lost": ("int-lost for=1",),
    "slow wires": ("slow factor=4 for=1", "slow factor=20 for=1"),
    "unplugged": ("unplugged for=2",),
    "unplugged for ever": ("unplugged",),
    "chip exchanged": ("swapped personality=MPU-6500",),
}
ROWS = tuple(row for rows in KINDS.values() for row in rows)
WIRED = "line: "
"""Before a fault: with the INT pin at a data-ready line."""
WIRED_KINDS: dict[str, tuple[str, ...]] = {
    "interrupts lost, with a line": ("line: int-lost for=1",),
    "supply dips, with a line": ("line: brown-out",),
    "pin changes, with a line": ("line: changed register=0x37 value=0x20", "line: changed register=0x38 value=0x10"),
}
WIRED_ROWS = tuple(row for rows in WIRED_KINDS.values() for row in rows)

WARM_S = 4.5
LATER_S = 2.0
TELLING = tuple(set(Health().as_dict()) - {"samples", "drains", "fifo_empty", "samples_lost"})
_REWRITTEN = (0x19, 0x1A, 0x1B, 0x1C)
_STEPS = {"reset": Step.WAIT_RESET, "configure": Step.CONFIGURE, "start": Step.START, "brought back": Step.CONFIGURE}


@dataclass
class Bed:
    """A chip on a board that tilts, the driver and the pipeline, drained at 100 Hz; `wired` with a data-ready line."""

    wired: bool = False
    clock: VirtualClock = field(default_factory=VirtualClock)
    health: Health = field(default_factory=Health)
    attitudes: list[AttitudeBlock] = field(default_factory=list)
    out_ns: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        settings = Settings()
        self.motion = Tilt(start_s=3.0)
        self.chip = FakeMpu6050(self.clock, motion=self.motion, imperfections=NOISE_ONLY, pll_error=0.01, seed=1)
        self.bus = FakeBus({0x68: self.chip}, clock=self.clock, name="fake:matrix")
        line = FakeDataReady(self.chip, clock=self.clock) if self.wired else None
        self.source = ChipSource(
            self.bus, address=0x68, config=settings.chip, clock=self.clock, health=self.health, line=line
        )
        self.pipeline = build_pipeline(settings)

    def twin(self) -> Bed:
        lock = self.bus.adapter.lock
        return copy.deepcopy(self, {id(lock): lock})

    def drain(self) -> None:
        """Go to the next deadline and drain."""
        period_ns = 10 * NS_PER_MS
        self.clock.sleep_until_ns((self.clock.now_ns() // period_ns + 1) * period_ns)
        block = self.pipeline.process(self.source.read())
        if len(block):
            self.attitudes.append(block)
            self.out_ns.append(self.clock.now_ns())

    def run_until(self, until_ns: int) -> None:
        while self.clock.now_ns() < until_ns:
            self.drain()

    def told(self) -> int:
        """All counters of trouble together."""
        return sum(getattr(self.health, name) for name in TELLING)

    def errors_deg(self) -> tuple[np.ndarray, np.ndarray]:
        """Times and tilt errors of all samples."""
        t_ns = np.concatenate([block.t_ns for block in self.attitudes])
        q = np.concatenate([block.q for block in self.attitudes])
        truth = self.motion.attitude(np.array([self.chip.world_time_s(int(t)) for t in t_ns]))
        return t_ns, np.degrees(inclination_between(truth, q))


@dataclass(frozen=True)
class Cell:
    """What became of a fault; times in ms, None where there is none to tell."""

    fault: str
    state: str
    error: ImuError | None = None
    happened: bool = False
    detect_ms: float | None = None
    recover_ms: float | None = None
    worse_deg: float | None = None
    unsaid: int = 0
    backwards: int = 0
    gaps: int = 0
    settling: bool = False

    @property
    def outcome(self) -> str:
        if self.error is not None:
            return f"{type(self.error).__name__} ({exit_code(self.error)})"
        if not self.happened:
            return "met nothing"
        return "recovered" if self.detect_ms is not None else "no effect"

    def __str__(self) -> str:
        if self.error is not None or not self.happened:
            return self.outcome
        detect = "–" if self.detect_ms is None else f"{self.detect_ms:.0f}"
        recover = "–" if self.recover_ms is None else f"{self.recover_ms:.0f}"
        flagged = ", flagged" if self.settling and (self.worse_deg or 0.0) > 1.0 else ""
        return f"{self.outcome} {detect} / {recover} ms, {self.worse_deg or 0.0:+.2f}°{flagged}"


@lru_cache(maxsize=2)
def warm(wired: bool = False) -> Bed:
    bed = Bed(wired=wired)
    bed.run_until(round(WARM_S * NS_PER_S))
    return bed


@lru_cache(maxsize=2)
def undisturbed(wired: bool = False) -> tuple[np.ndarray, np.ndarray]:
    bed = warm(wired).twin()
    bed.run_until(bed.clock.now_ns() + 18 * NS_PER_S)
    return bed.errors_deg()


def bed_in(state: str, wired: bool = False) -> Bed:
    """A bed whose driver is in this state."""
    bed = Bed(wired=wired) if state in ("reset", "configure", "start") else warm(wired).twin()
    if state == "brought back":
        bed.bus.adapter.faults.add(parse("brown-out"))
    while state != "streaming" and bed.source.step is not _STEPS[state]:
        bed.drain()
    return bed


def cell(fault: str, state: str) -> Cell:
    """Let a fault happen in a state, and see."""
    wired = fault.startswith(WIRED)
    bed, entry = bed_in(state, wired), parse(fault.removeprefix(WIRED))
    told, faults = bed.told(), bed.bus.adapter.faults
    old = len(faults.history)
    faults.add(entry)
    if state == "streaming" and isinstance(entry.kind, FlippedWrite | CutWrite):
        # Nothing is written to a chip that is well.
        register = getattr(entry.kind, "register", None)
        change = f"changed bit=0 register={register}" if register in _REWRITTEN else "slip bytes=1"
        faults.add(parse(change))
        old += 1
    begin_ns = bed.clock.now_ns()
    planned_end_ns = begin_ns + round((entry.for_s or 0.0) * NS_PER_S)
    detect_ns: int | None = None
    error: ImuError | None = None
    end_ns = begin_ns
    least_ns = 12 * NS_PER_S if fault.startswith(("unplugged", "swapped")) and entry.for_s is None else 0
    try:
        while bed.clock.now_ns() < max(end_ns + round((LATER_S + 0.6) * NS_PER_S), begin_ns + least_ns):
            bed.drain()
            if detect_ns is None and bed.told() > told and len(faults.history) > old:
                detect_ns = bed.clock.now_ns()
            if len(faults.history) > old:
                held_s = entry.kind.takes_s if isinstance(entry.kind, TimedOut) else 0.0
                end_ns = max(planned_end_ns, faults.history[-1].t_ns + round(held_s * NS_PER_S))
    except ImuError as caught:
        error = caught
    happened = len(faults.history) > old
    first_ns = faults.history[old].t_ns if happened else begin_ns
    if error is not None or not bed.attitudes:
        return Cell(fault, state, error, happened)
    t_ns, errors = bed.errors_deg()
    flags = np.concatenate([block.flags for block in bed.attitudes])
    good = [
        out
        for out, block in zip(bed.out_ns, bed.attitudes, strict=True)
        if out >= end_ns and block.t_ns[-1] > end_ns - 20 * NS_PER_MS and not block.flags[-1] & Flag.STUCK
    ]
    # What was still in the FIFO does not count where a longer pause follows.
    pauses = [after for before, after in pairwise(good) if after - before > 45 * NS_PER_MS]
    again_ns = max(pauses) if pauses else good[0] if good else None
    steps = np.diff(t_ns)
    late = t_ns >= end_ns + LATER_S * NS_PER_S
    base_t, base_errors = undisturbed(wired)
    worse = errors[late] - np.interp(t_ns[late], base_t, base_errors)
    return Cell(
        fault,
        state,
        None,
        happened,
        None if detect_ns is None else (detect_ns - first_ns) / NS_PER_MS,
        None if again_ns is None else (again_ns - end_ns) / NS_PER_MS,
        float(worse.max()) if late.any() else None,
        int(((steps > 2.6 * 5 * NS_PER_MS) & (flags[1:] & Flag.GAP == 0)).sum()),
        int((steps <= 0).sum()),
        int((flags & Flag.GAP != 0).sum()),
        bool((flags[late][worse > 1.0] & Flag.SETTLING).all()),
    )


def table(rows: tuple[str, ...] = ROWS, states: tuple[str, ...] = STATES) -> str:
    """The matrix as Markdown: outcome, ms until it was noticed / until the first good sample after its end, and by how
    much the tilt was worse two seconds later than without it; in the self-test, until it was measured anew / until the
    verdict after its end."""
    lines = [f"| fault | {' | '.join(states)} | self-test |", "|---" * (len(states) + 2) + "|"]
    lines += [
        f"| `{row}` | {' | '.join(str(cell(row, state)) for state in states)} | {self_test_cell(row)} |" for row in rows
    ]
    return "\n".join(lines)


def short_table(*, self_test: bool = True) -> str:
    """The worst of each kind while streaming, and in the self-test, as Markdown."""
    lines = [
        "| fault, while streaming | noticed within | samples again after its end | tilt worse by, 2 s later |"
        + (" self-test's verdict |" if self_test else ""),
        "|---|---|---|---|" + ("---|" if self_test else ""),
    ]
    for kind, rows in KINDS.items():
        tested = f" {summed_up([self_test_cell(row) for row in rows])} |" if self_test else ""
        lines.append(f"| {kind} | {_streaming(rows)} |{tested}")
    # The self-test uses no line.
    lines += [f"| {kind} | {_streaming(rows)} |{' |' * self_test}" for kind, rows in WIRED_KINDS.items()]
    return "\n".join(lines)


def _streaming(rows: tuple[str, ...]) -> str:
    cells = [cell(row, "streaming") for row in rows]
    errors = [c.outcome for c in cells if c.error is not None]
    if errors:
        return f"{errors[0]} | |"
    noticed = [c.detect_ms for c in cells if c.detect_ms is not None]
    again = [c.recover_ms for c in cells if c.recover_ms is not None]
    worse = max(c.worse_deg or 0.0 for c in cells)
    return f"{f'{max(noticed):.0f} ms' if noticed else 'no effect'} | {max(again):.0f} ms | {worse:.2f}°"


if __name__ == "__main__":
    logging.disable(logging.WARNING)
    print(short_table() if "--short" in sys.argv else table())
