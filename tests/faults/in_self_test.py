"""Every fault while the self-test measures: whether its verdict is the true one, and what state the chip is left in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw_fakes import NOISE_ONLY, FakeBus, FakeMpu6050, Still
from hw_fakes.faults.of_wires import TimedOut
from hw_fakes.faults.plan import parse
from quavelet.cli.exits import exit_code
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import ImuError
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.config import configuration_table
from quavelet.mpu6050.self_test import SelfTestReport, run_self_test
from quavelet.mpu6050.source import ChipSource
from quavelet.mpu6050.variants import MPU6050
from quavelet.settings import Settings

PUSHED_S = 0.8
"""Since the begin of a self-test that nothing disturbs: in the midst of the measurement with self-test on."""
MOMENTS_S = {"set up": 0.02, "off": 0.4, "response": 0.6, "on": PUSHED_S, "off again": 1.4, "given back": 1.675}
GYRO_X_RESPONSE = 6725
"""Counts of the fake's codes at +-250 deg/s."""
STREAM_S = 0.3


class TestBoard:
    """A chip lying still, which streamed and is then put to its self-test, as the doctor does.

    broken   its gyroscope does not respond about x
    """

    __test__ = False

    def __init__(self, *, broken: bool = False) -> None:
        self.clock, self.health = VirtualClock(), Health()
        self.chip = FakeMpu6050(self.clock, motion=Still(roll_deg=3, pitch_deg=-5), imperfections=NOISE_ONLY, seed=1)
        self.bus = FakeBus({0x68: self.chip}, clock=self.clock, name="fake:self-test")
        self.config = Settings().chip
        if broken:
            self.chip.spoil_words = self._without_response
        self.streams()

    def run(self, repeated_ns: list[int]) -> SelfTestReport:
        access = RegisterAccess(self.bus, address=0x68, clock=self.clock, health=self.health)
        return run_self_test(
            access,
            variant=MPU6050,
            clock=self.clock,
            on_repeat=lambda _reason: repeated_ns.append(self.clock.now_ns()),
        )

    def streams(self) -> bool:
        """Whether a source can stream from the chip as it stands, with self-test off."""
        source = ChipSource(self.bus, address=0x68, config=self.config, clock=self.clock, health=self.health)
        source.wait_until_streaming()
        n, end_ns = 0, self.clock.now_ns() + round(STREAM_S * NS_PER_S)
        while self.clock.now_ns() < end_ns:
            self.clock.advance_ns(20 * NS_PER_MS)
            n += len(source.read())
        return n > 0.8 * STREAM_S * self.config.sample_rate_hz and not self.pushed

    @property
    def pushed(self) -> bool:
        """Whether any bit of the self-test stands in the chip."""
        return bool((self.chip.registers[0x1B] | self.chip.registers[0x1C]) & 0xE0)

    @property
    def configuration(self) -> bytes:
        table = configuration_table(self.config, variant=MPU6050)
        return bytes(self.chip.registers[row.register.address] for row in table)

    def _without_response(self, words):
        if self.chip.registers[0x1B] & 0x80:
            words = words.copy()
            words[:, 4] -= np.int16(GYRO_X_RESPONSE)
        return words


@dataclass(frozen=True)
class SelfTestCell:
    """What became of a fault; times in ms, None where there is none to tell.

    verdict      whether the chip passed; None where there was none, or only that the board moved
    as_found     the registers are as before, where there was a verdict
    streams      the chip streams again once the fault is over
    detect_ms    from the fault to the decision to measure anew
    recover_ms   from the end of the fault to the verdict
    """

    fault: str
    error: ImuError | None
    happened: bool
    verdict: bool | None
    as_found: bool
    streams: bool
    repeats: int
    disturbed: int
    detect_ms: float | None
    recover_ms: float | None

    @property
    def outcome(self) -> str:
        if self.error is not None:
            return f"{type(self.error).__name__} ({exit_code(self.error)})"
        if not self.happened:
            return "met nothing"
        if self.verdict is None:
            return "no verdict: it moved"
        return "recovered" if self.repeats or self.disturbed else "no effect"

    def __str__(self) -> str:
        if self.error is not None or self.verdict is None or not self.happened or self.detect_ms is None:
            return self.outcome
        times = f"measured {self.repeats + 1} times" if self.repeats else "given back anew"
        return f"{self.outcome} {self.detect_ms:.0f} / {self.recover_ms:.0f} ms, {times}"


def summed_up(cells: list[SelfTestCell]) -> str:
    """What became of the faults of one kind, in a few words."""
    said = [cell.outcome for cell in cells if cell.verdict is None and cell.happened]
    told = [cell for cell in cells if cell.verdict is not None]
    if told:
        repeats, longest_ms = max(c.repeats for c in told), max(c.recover_ms or 0.0 for c in told if c.happened)
        said.insert(0, f"true after {longest_ms / 1000:.1f} s, {repeats} repeated" if repeats else "true")
    return "; ".join(dict.fromkeys(said))


def self_test_cell(fault: str, *, at_s: float = PUSHED_S, broken: bool = False) -> SelfTestCell:
    """Let a fault happen `at_s` after a self-test has begun, and see."""
    board, entry = TestBoard(broken=broken), parse(fault)
    before, faults = board.configuration, board.bus.adapter.faults
    begin_s = faults.time_s()
    faults.add(parse(f"{fault} at={begin_s + at_s:.6f}"))
    repeated_ns: list[int] = []
    report: SelfTestReport | None = None
    error: ImuError | None = None
    try:
        report = board.run(repeated_ns)
    except ImuError as caught:
        error = caught
    done_ns, as_found = board.clock.now_ns(), board.configuration == before
    happened = bool(faults.history)
    struck_ns = faults.history[0].t_ns if happened else done_ns
    held_s = entry.kind.takes_s if isinstance(entry.kind, TimedOut) else 0.0
    end_ns = max([struck_ns + round((entry.for_s or held_s) * NS_PER_S), *(it.t_ns for it in faults.history)])
    later = [t for t in repeated_ns if t >= struck_ns]
    if entry.for_s is None:
        faults.clear()
    else:
        board.clock.sleep_until_ns(end_ns + 20 * NS_PER_MS)
    return SelfTestCell(
        fault,
        error,
        happened,
        report.passed if report is not None and report.still else None,
        as_found,
        board.streams(),
        0 if report is None else report.repeats,
        board.health.bus_errors,
        (later[0] - struck_ns) / NS_PER_MS if later else None,
        (done_ns - end_ns) / NS_PER_MS,
    )
