"""The steps in which the board just lies: warming up, bias at rest, bias over temperature."""

from __future__ import annotations

from collections.abc import Iterable

from quavelet.bench.session_evidence import Evidence
from quavelet.bench.session_watch import COLDEST_DEGC, HOTTEST_DEGC, POSE_S, STILL_S, Seen
from quavelet.bench.steps.step import Step
from quavelet.calibration.poses import StillPose
from quavelet.core.instruction import Instruction
from quavelet.core.units import NS_PER_S

SETTLED_DEGC_MIN = 0.5
"""At 0.19 deg/s/degC the data sheet's worst bias then goes by 0.1 deg/s a minute, which the poses follow."""
WARM_UP_LONGEST_S = 600.0
REST_POSES = 7
SPAN_DEGC = 12.0
STANDS_S = 45.0
MOVED = "the board was moved: put it down, let go, and leave it"


def beyond_sheet(seen: Seen) -> str:
    """What is to be said of the temperature, "" where it is within the data sheet's with a margin."""
    if COLDEST_DEGC <= seen.temp_degc <= HOTTEST_DEGC:
        return ""
    if seen.temp_degc < COLDEST_DEGC:
        return f"the chip is at {seen.temp_degc:.0f} degC, and is not specified below -40: let it warm up"
    return f"the chip is at {seen.temp_degc:.0f} degC, and is not specified beyond 85: take the heat away"


class WarmUp(Step):
    """Until the temperature hardly goes any more; after ten minutes it is taken as it is."""

    name = "warm-up"
    title = "Warm-up"

    def __init__(self, evidence: Evidence) -> None:
        super().__init__(evidence)
        self._done = self._was_still = False
        self._begun_ns: int | None = None
        self._steepest = 0.0
        self._trend: float | None = None

    @property
    def instruction(self) -> Instruction:
        return Instruction(action="rest")

    @property
    def progress(self) -> float:
        if self._done or self._trend is None or self._steepest <= SETTLED_DEGC_MIN:
            return float(self._done)
        return max(0.0, min(0.99, (self._steepest - abs(self._trend)) / (self._steepest - SETTLED_DEGC_MIN)))

    @property
    def status(self) -> str:
        if self._trend is None:
            return "watching the temperature"
        return f"waits for less than {SETTLED_DEGC_MIN:g} degC/min"

    def take(self, seen: Seen) -> None:
        now_ns = int(seen.rows.t_ns[-1])
        self._begun_ns = self._begun_ns or now_ns
        was_still, self._was_still = self._was_still, seen.still_s > 0.0
        wrong = beyond_sheet(seen)
        if wrong:
            self.notice = wrong
        elif was_still and not self._was_still:
            self.notice = MOVED
        elif seen.poses or self.notice != MOVED:
            self.notice = ""
        if not wrong:
            self.evidence.rest += seen.poses
        self._trend = seen.trend_degc_min
        if self._trend is None or wrong:
            return
        self._steepest = max(self._steepest, abs(self._trend))
        self._done = abs(self._trend) < SETTLED_DEGC_MIN or now_ns - self._begun_ns > WARM_UP_LONGEST_S * 1e9


class _Lying(Step):
    """Poses of the lying board, from where the step was begun."""

    @property
    def poses(self) -> list[StillPose]:
        rest = self.evidence.rest
        return rest[self.evidence.begun.get(self.name, len(rest)) :]

    def keep(self, poses: Iterable[StillPose]) -> None:
        self.evidence.begun.setdefault(self.name, len(self.evidence.rest))
        self.evidence.rest += poses


class Rest(_Lying):
    """Twenty seconds of stillness: the gyroscope's bias."""

    name = "rest"
    title = "Gyroscope at rest"

    def __init__(self, evidence: Evidence) -> None:
        super().__init__(evidence)
        self._since_s = 0.0

    @property
    def instruction(self) -> Instruction:
        return Instruction(action="rest")

    @property
    def progress(self) -> float:
        return min(1.0, (len(self.poses) + min(self._since_s, 0.9 * STILL_S) / STILL_S) / REST_POSES)

    @property
    def status(self) -> str:
        return f"{min(REST_POSES, len(self.poses)) * POSE_S:.0f} of {REST_POSES * POSE_S:.0f} s"

    def take(self, seen: Seen) -> None:
        hot, was_still = beyond_sheet(seen), self._since_s > 0.0
        self._since_s = min(seen.still_s, STILL_S)
        if hot:
            self.notice = hot
        elif was_still and seen.still_s == 0.0:
            self.notice = MOVED
        elif seen.poses or self.notice != MOVED:
            # Who looks at the board and not at the screen finds it there until it is mended.
            self.notice = ""
        if not hot:
            self.keep(seen.poses)

    @property
    def needs_s(self) -> float:
        return STILL_S


class Temperature(_Lying):
    """The board is warmed and lies while it cools: the bias over so many degrees, or until it cools no more."""

    name = "temperature"
    title = "Bias over temperature"

    def __init__(self, evidence: Evidence) -> None:
        super().__init__(evidence)
        self._stands_since_ns: int | None = None
        self._trend: float | None = None

    @property
    def instruction(self) -> Instruction:
        return Instruction(action="warm")

    @property
    def progress(self) -> float:
        return min(1.0, self._span / SPAN_DEGC)

    @property
    def status(self) -> str:
        return f"{self._span:.1f} of {SPAN_DEGC:g} degC"

    def take(self, seen: Seen) -> None:
        self.notice = beyond_sheet(seen)
        self._trend = seen.trend_degc_min
        if not self.notice:
            self.keep(seen.poses)
        now_ns = int(seen.rows.t_ns[-1])
        if self._trend is None or abs(self._trend) >= SETTLED_DEGC_MIN:
            self._stands_since_ns = None
        elif self._stands_since_ns is None:
            self._stands_since_ns = now_ns
        # Where warming becomes cooling it stands still for a moment, too.
        elif not self.notice and self._span > 1.0 and now_ns - self._stands_since_ns > STANDS_S * NS_PER_S:
            self.notice = "the temperature stands still too early: warm the board more, or cool it in a bag in a fridge"

    @property
    def needs_s(self) -> float:
        return STILL_S

    @property
    def _span(self) -> float:
        temps = [pose.temp_degc for pose in self.poses]
        return max(temps) - min(temps) if temps else 0.0
