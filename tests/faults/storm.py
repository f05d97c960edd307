"""Random faults of every kind on a stream whose every frame is known, until so many transactions are made.

`python tests/faults/storm.py --transactions 1000000 --seed 1` and `--hours 24 --per-minute 1` print what came of it.
"""

from __future__ import annotations

import argparse
import logging
import resource
import sys
import time
import tracemalloc
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "mpu6050"))

from chip_rig import ADDRESS, config

from hw_fakes import NOISE_ONLY, FakeBus, FakeDataReady, FakeMpu6050, Tilt
from hw_fakes.faults.engine import Faults
from hw_fakes.faults.plan import parse
from quavelet.core.blocks import CountArray, Flag, RawBlock
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import ImuError
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050.source import ChipSource
from quavelet.pipeline import build_pipeline
from quavelet.settings import Settings

WIRES = (
    "nack", "nack n=7", "time-out takes=0.02", "eio", "eio n=4", "arbitration", "flip", "flip register=0x72",
    "flip register=0x73", "flip register=0x3a", "flip-write", "cut-write", "torn", "torn lost=14", "garbage", "zeros",
    "ones", "zeros for=0.02", "ones for=0.02", "slow factor=4 n=5",
)  # fmt: skip
CHIPS = (
    "brown-out", "asleep", "changed", "changed", "slip bytes=1", "slip bytes=5", "slip bytes=-1", "slip bytes=14",
    "overflow", "frozen for=0.4", "temperature by=30 for=0.2", "int-lost for=0.3", "unplugged for=0.05",
    "unplugged for=0.7",
)  # fmt: skip
KEPT_FRAMES = 20_000
WIRE_SHARE = 0.75
DATA_KINDS = ("flip", "torn", "garbage")
"""They can spoil words of a frame and leave all the rest plausible."""
ANY: frozenset[int] = frozenset()
"""Nobody knows which."""


class Known:
    """What a chip has put into its FIFO, frame by frame, newest last: what is given out is compared with it.

    Frames are found by all their fourteen bytes; noise makes each one of its kind, but for those of a frozen chip.
    """

    def __init__(self, chip: FakeMpu6050) -> None:
        self.frames: dict[bytes, set[int]] = {}
        self.by_number: dict[int, bytes] = {}
        self.number = 0
        push = chip.fifo.push

        def pushed(data: bytes) -> bool:
            for at in range(0, len(data) - 13, 14):
                frame = bytes(data[at : at + 14])
                self.number += 1
                self.frames.setdefault(frame, set()).add(self.number)
                self.by_number[self.number] = frame
            while len(self.by_number) > KEPT_FRAMES:
                oldest = next(iter(self.by_number))
                frame = self.by_number.pop(oldest)
                self.frames[frame].remove(oldest)
                if not self.frames[frame]:
                    del self.frames[frame]
            return push(data)

        chip.fifo.push = pushed


@dataclass
class Outcome:
    """What came of it."""

    seed: int
    transactions: int = 0
    faults: int = 0
    samples: int = 0
    gaps: int = 0
    lost: int = 0
    errors: dict[str, int] = field(default_factory=dict)
    wrong: list[tuple[str, int, float]] = field(default_factory=list)
    """Samples that no chip made and no flag tells of: what had happened, largest count off, deg it turned the board."""
    spoilt_reads: int = 0
    spikes: int = 0
    implausible: int = 0
    unsaid: int = 0
    vanished: int = 0
    backwards: int = 0
    virtual_s: float = 0.0
    took_s: float = 0.0
    memory: tuple[int, int] = (0, 0)
    resident_mb: tuple[float, float] = (0.0, 0.0)
    tilt_off_deg: float = 0.0
    health: Health = field(default_factory=Health)

    def __str__(self) -> str:
        worst = max((deg for _, _, deg in self.wrong), default=0.0)
        return (
            f"seed {self.seed}: {self.transactions} transactions, {self.faults} faults, {self.virtual_s / 3600:.2f} h "
            f"of the chip's time in {self.took_s:.0f} s; {self.samples} samples, {self.gaps} gaps, {self.lost} lost; "
            f"errors {self.errors or 'none'}; {self.unsaid} gaps unsaid, "
            f"{self.vanished} whole frames vanished; time back {self.backwards} times; "
            f"{self.spoilt_reads} transfers of frames were spoilt: {self.spikes} spikes and {self.implausible} frames "
            f"thrown away, {len(self.wrong)} wrong samples not noticed, the worst turns the board by {worst:.3f} deg; "
            f"memory {self.memory[0] / 1e6:.2f} to {self.memory[1] / 1e6:.2f} MB traced, "
            f"{self.resident_mb[0]:.0f} to {self.resident_mb[1]:.0f} MB resident"
        )


def storm(
    *,
    seed: int,
    transactions: int | None = None,
    virtual_s: float | None = None,
    p: float | None = 0.01,
    per_minute: float | None = None,
    rate_hz: float = 200.0,
    dlpf: int = 3,
    loop_ms: float = 10.0,
    traced: bool = False,
    attitude: bool = False,
    wired: bool = False,
) -> Outcome:
    """Run until `transactions` or `virtual_s` have passed.

    p            chance of a fault for each transaction, over all kinds
    per_minute   or so many on average
    wired        with the INT pin at a data-ready line
    attitude     through the pipeline too: how far the tilt is off at worst where nothing is flagged is then known
    """
    rng, out, clock = Random(seed), Outcome(seed), VirtualClock(5 * NS_PER_S)
    motion = Tilt(start_s=8.0)
    chip = FakeMpu6050(clock, motion=motion, imperfections=NOISE_ONLY, pll_error=0.01, seed=seed)
    known = Known(chip)
    bus = FakeBus({ADDRESS: chip}, clock=clock, name="fake:storm")
    faults = bus.adapter.faults
    chip_config = config(rate_hz, dlpf=dlpf)
    settings = Settings()

    def fresh() -> ChipSource:
        line = FakeDataReady(chip, clock=clock) if wired else None
        return ChipSource(bus, address=ADDRESS, config=chip_config, clock=clock, health=out.health, line=line)

    for k, text in enumerate((*WIRES, *CHIPS)):
        share = WIRE_SHARE / len(WIRES) if k < len(WIRES) else (1 - WIRE_SHARE) / len(CHIPS)
        often = f"p={p * share:.9f}" if p is not None else f"per_minute={(per_minute or 1.0) * share:.9f}"
        faults.add(parse(f"{text} {often} seed={seed}"))
    source, pipeline = fresh(), build_pipeline(settings)
    last_t_ns, last = 0, ANY
    begin_ns, began_s = clock.now_ns(), time.monotonic()
    warm = 0.1
    while True:
        done = (
            (bus.transactions / transactions)
            if transactions
            else (clock.now_ns() - begin_ns) / NS_PER_S / (virtual_s or 1)
        )
        if done >= warm and not out.resident_mb[0]:
            out.resident_mb = (_resident_mb(), 0.0)
            if traced:
                tracemalloc.start()
                out.memory = (tracemalloc.get_traced_memory()[0], 0)
        if done >= 1:
            break
        now_ns = clock.now_ns()
        clock.sleep_until_ns(now_ns + round(loop_ms * NS_PER_MS * (rng.uniform(0.3, 1.8) if p else 1.0)))
        try:
            block = source.read()
        except ImuError as error:
            name = type(error).__name__
            out.errors[name] = out.errors.get(name, 0) + 1
            source, last = fresh(), ANY
            continue
        if not len(block):
            continue
        out.samples += len(block)
        out.backwards += int((np.diff(block.t_ns, prepend=last_t_ns) <= 0).sum())
        last_t_ns = int(block.t_ns[-1])
        last = _compared(out, block, known, last, faults)
        if attitude:
            pipeline.process(block)
        if len(faults.history) > 1000:
            out.faults += len(faults.history)
            out.spoilt_reads += _spoilt(faults.history)
            faults.history.clear()
    out.faults += len(faults.history)
    out.spoilt_reads += _spoilt(faults.history)
    out.transactions, out.virtual_s = bus.transactions, (clock.now_ns() - begin_ns) / NS_PER_S
    out.took_s = time.monotonic() - began_s
    h = out.health
    out.gaps, out.lost, out.spikes, out.implausible = h.gaps, h.samples_lost, h.spikes, h.frames_implausible
    out.resident_mb = (out.resident_mb[0], _resident_mb())
    if traced:
        out.memory = (out.memory[0], tracemalloc.get_traced_memory()[0])
        tracemalloc.stop()
    return out


def _spoilt(history) -> int:
    return sum(it.kind.name in DATA_KINDS and it.touch.register == 0x74 for it in history)


def _compared(out: Outcome, block: RawBlock, known: Known, last: frozenset[int], faults: Faults) -> frozenset[int]:
    """Compare each sample with what the chip made. last: which of its frames the sample before may have been."""
    rows = block.counts.astype(">i2")
    flagged = (block.flags & ~np.uint32(Flag.CLOCK_UNSURE)) != 0
    for k in range(len(rows)):
        may_be = known.frames.get(rows[k].tobytes(), ANY)
        if not may_be:
            if not flagged[k]:
                out.wrong.append(_how_wrong(block, rows[k], k, known, last, faults))
            last = ANY if block.flags[k] & Flag.GAP else frozenset(number + 1 for number in last)
            continue
        if not last:
            last = frozenset(may_be)
            continue
        follows = frozenset(number for number in may_be if number - 1 in last)
        if block.flags[k] & (Flag.GAP | Flag.STUCK):
            follows = frozenset(number for number in may_be if number > min(last))
        elif not follows:
            # A whole frame that vanishes out of the FIFO leaves no trace in what is read.
            vanished = any(number - 2 in last for number in may_be) and any(
                it.touch.what.startswith("14 bytes") for it in faults.history
            )
            out.vanished += vanished
            out.unsaid += not vanished
        last = follows or frozenset(may_be)
    return last


def _how_wrong(
    block: RawBlock, row: CountArray, k: int, known: Known, last: frozenset[int], faults: Faults
) -> tuple[str, int, float]:
    spoilt = [it for it in faults.history if it.touch.register == 0x74]
    what = f"{spoilt[-1].kind.name}: {spoilt[-1].touch}" if spoilt else "nothing"
    true = known.by_number.get(min(last) + 1) if last else None
    if true is None:
        return what, -1, 0.0
    off = np.abs(np.frombuffer(true, ">i2").astype(np.int64) - row.astype(np.int64))
    turn_rad = float(off[4:].max()) * block.scale.gyro_rad_s_per_lsb * float(block.period_s[k])
    return what, int(np.delete(off, 3).max()), float(np.degrees(turn_rad))


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--transactions", type=int)
    parser.add_argument("--hours", type=float)
    parser.add_argument("--per-minute", type=float)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rate", type=float, default=200.0)
    asked = parser.parse_args()
    logging.disable(logging.WARNING)
    out = storm(
        seed=asked.seed,
        transactions=asked.transactions,
        virtual_s=None if asked.hours is None else asked.hours * 3600,
        p=None if asked.per_minute else 0.01,
        per_minute=asked.per_minute,
        rate_hz=asked.rate,
        dlpf=1 if asked.rate > 200 else 3,
    )
    print(out)
    print(out.health)
    for wrong in sorted(out.wrong, key=lambda w: -w[2])[:15]:
        print("not noticed:", wrong)


if __name__ == "__main__":
    main()
