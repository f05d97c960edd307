"""Motion, zero motion and free fall of the MPU-6050, and wake on motion of the 6500 class: interrupts without a reader.

The first three are described in the register map before rev 4.2 (registers 29 to 34, 97 and 105) and are in the
silicon. What those pages leave open is chosen here, and said where it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, exp, pi
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hw_fakes.chip import registers as reg
from hw_fakes.chip.samples import Run, SampleSource
from hw_fakes.chip.setup import Setup
from quavelet.core.units import NS_PER_MS

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_HIGH_PASS_HZ = {1: 5.0, 2: 2.5, 3: 1.25, 4: 0.63}  # by ACCEL_CONFIG bits 2:0
_HOLD = 7
_TO_ZERO = 1 << 30
_DOWN = (_TO_ZERO, 1, 2, 4)  # what a sample that does not qualify takes off a counter (register 105)
_REST_MS_LSB = 64  # register 34
_NEGATIVE, _POSITIVE = (0x80, 0x20, 0x08), (0x40, 0x10, 0x04)  # MOT_DETECT_STATUS, x y z
_START_MS = 4  # register 105: at least so long after waking the detectors see their first sample
_WAKE_G_LSB = 0.004  # RM9250 register 31


@dataclass(frozen=True, slots=True)
class Event:
    """Something was detected.

    ticks      of the gyroscope's outputs since the run began
    interrupt  the bit of INT_STATUS
    status     bits of MOT_DETECT_STATUS it sets
    at_rest    what the zero-motion bit there is from now on; None: as before
    """

    ticks: int
    interrupt: int
    status: int = 0
    at_rest: bool | None = None


class Rules(Protocol):
    """What counts as an event."""

    start_ms: int
    """From waking to the first sample that is looked at."""

    def obey(self, registers: bytes | bytearray) -> bool:
        """Take over the thresholds; False where nothing can be detected with them."""
        ...

    def watched(self, run: Run, setup: Setup) -> Run:
        """The samples that are looked at."""
        ...

    def restart(self) -> None:
        """Forget all samples."""
        ...

    def scan(self, accel_g: FloatArray, axes: list[int], sample_ms: float) -> list[tuple[int, Event]]:
        """Events among the next samples (n, 3), in order, each with the number of its row."""
        ...


class Detection:
    """Looks at each sample of the accelerometer once, in order, whenever somebody may see what comes of it."""

    def __init__(self, source: SampleSource, rules: Rules) -> None:
        self._source = source
        self._rules = rules
        self._run: Run | None = None
        self._setup: Setup | None = None
        self._axes: list[int] = []  # not in standby
        self._seen = 0  # of the samples of this run
        self._chunk = -1
        self._accel_g: FloatArray = np.zeros((0, 3))

    def follow(self, registers: bytes | bytearray, run: Run | None, setup: Setup, now_ns: int) -> None:
        """Obey the configuration from `now_ns` on."""
        active, before = self._rules.obey(registers), self._run
        self._axes = [axis for axis in range(3) if axis not in setup.frozen]
        self._run = self._rules.watched(run, setup) if active and run and self._axes else None
        if (self._run, setup) != (before, self._setup):
            self._chunk = -1
        self._setup = setup
        if self._run is None:
            self._rules.restart()
        else:
            seen = self._seen if self._run == before else self._run.samples_by(now_ns)
            start_ns = self._run.awake_since_ns + self._rules.start_ms * NS_PER_MS
            self._seen = max(seen, self._run.samples_by(start_ns))

    def forget(self) -> None:
        """Samples that were computed ahead are not valid any more."""
        self._chunk = -1

    def restart(self) -> None:
        """The signal path is reset: the high-pass filter and the counters begin anew."""
        self._rules.restart()

    def events(self, now_ns: int) -> list[Event]:
        """What was detected since the last call, oldest first."""
        run, setup = self._run, self._setup
        if run is None or setup is None:
            return []
        due, found = run.samples_by(now_ns), []
        while self._seen < due:
            chunk, row = divmod(self._seen, run.chunk)
            if chunk != self._chunk:
                self._chunk, words = chunk, self._source.words(run, setup, chunk)
                self._accel_g = words[:, :3] / setup.accel_lsb_per_g
            rows = min(due - self._seen, run.chunk - row)
            sample_ms = 1000 * run.divider / run.nominal_hz
            for i, event in self._rules.scan(self._accel_g[row : row + rows], self._axes, sample_ms):
                found.append(replace(event, ticks=(self._seen + i + 1) * run.divider))
            self._seen += rows
        return found


class MotionRules:
    """The MPU-6050's detectors, by registers 0x1C to 0x22 and 0x69.

    They see the accelerometer at 1 kHz whatever the sample rate, or each sample of a chip that cycles. Motion is any
    axis above its threshold behind the high-pass filter, zero motion all of them below theirs, free fall all below
    theirs without the filter. A counter of samples goes up with each that qualifies, and stops at its duration; an
    event is the moment it gets there, and for zero motion also the moment it is left. A duration of 0 is taken as 1,
    and a counter begins anew with each change of these registers.
    """

    def __init__(self, *, g_lsb: float) -> None:
        self.start_ms = _START_MS
        self._g_lsb = g_lsb
        self._raw = bytes(8)
        self._motion, self._rest, self._fall = 0, 0, 0  # the counters
        self._slow: FloatArray | None = None  # what the high-pass filter takes away
        self._last: FloatArray | None = None

    def obey(self, registers: bytes | bytearray) -> bool:
        raw = bytes([registers[reg.ACCEL_CONFIG] & 7, *registers[reg.FF_THR : reg.ZRMOT_DUR + 1]])
        raw += bytes([registers[reg.MOT_DETECT_CTRL]])
        if raw != self._raw:
            if raw[0] == _HOLD != self._raw[0]:
                self._slow = self._last
            self._raw = raw
            self._motion, self._rest, self._fall = 0, 0, 0
            self.start_ms = _START_MS + (raw[7] >> 4 & 3)
        high_pass, fall, _, _, _, rest, _, _ = raw
        return high_pass == _HOLD or high_pass in _HIGH_PASS_HZ or fall > 0 or rest > 0

    def watched(self, run: Run, setup: Setup) -> Run:
        return run if setup.cycle else replace(run, divider=run.nominal_hz // 1000)

    def restart(self) -> None:
        self._motion, self._rest, self._fall = 0, 0, 0
        self._slow = self._last = None

    def scan(self, accel_g: FloatArray, axes: list[int], sample_ms: float) -> list[tuple[int, Event]]:
        _, fall, fall_duration, motion, motion_duration, rest, rest_duration, control = self._raw
        moved_g, found = self._high_passed(accel_g, sample_ms), []
        size_g = np.abs(moved_g[:, axes])
        turns, self._motion = _turns(
            np.any(size_g > motion * self._g_lsb, axis=1), self._motion, max(1, motion_duration), _DOWN[control & 3]
        )
        for i, there in turns:
            if there:
                status = _signs(moved_g[i], axes, motion * self._g_lsb)
                found.append((i, Event(0, reg.MOT_INT, status=status)))
        turns, self._rest = _turns(
            np.all(size_g < rest * self._g_lsb, axis=1),
            self._rest,
            max(1, ceil(rest_duration * _REST_MS_LSB / sample_ms)),
            _TO_ZERO,
        )
        found += [(i, Event(0, reg.ZMOT_INT, at_rest=there)) for i, there in turns]
        turns, self._fall = _turns(
            np.all(np.abs(accel_g[:, axes]) < fall * self._g_lsb, axis=1),
            self._fall,
            max(1, fall_duration),
            _DOWN[control >> 2 & 3],
        )
        found += [(i, Event(0, reg.FF_INT)) for i, there in turns if there]
        return sorted(found, key=lambda at: at[0])

    def _high_passed(self, accel_g: FloatArray, sample_ms: float) -> FloatArray:
        """The accelerometer without what is slow; all 0 where the filter is off, as it gives in its reset mode."""
        mode = self._raw[0]
        self._last = accel_g[-1]
        if mode == _HOLD:
            self._slow = accel_g[0] if self._slow is None else self._slow
            return accel_g - self._slow
        if mode not in _HIGH_PASS_HZ:
            self._slow = None
            return np.zeros_like(accel_g)
        # One pole at the rate of the samples: slow[n] = keep slow[n - 1] + (1 - keep) accel[n]. A chunk is some seconds
        # long, so that keep to the power of minus its length is far from the largest number.
        keep = exp(-2 * pi * _HIGH_PASS_HZ[mode] * sample_ms / 1000)
        power = keep ** np.arange(1, len(accel_g) + 1)[:, None]
        begin = accel_g[0] if self._slow is None else self._slow
        slow = power * (begin + (1 - keep) * np.cumsum(accel_g / power, axis=0))
        self._slow = slow[-1]
        return accel_g - slow


class WakeOnMotion:
    """The 6500 class's detector: each sample in which an axis differs from the one before by more than WOM_THR.

    It is on with both top bits of ACCEL_INTEL_CTRL; of the other mode, comparing with the first sample, RM9250
    register 105 says that it is not used.
    """

    def __init__(self) -> None:
        self.start_ms = _START_MS
        self._above_g = 0.0
        self._last: FloatArray | None = None

    def obey(self, registers: bytes | bytearray) -> bool:
        self._above_g = registers[reg.MOT_THR] * _WAKE_G_LSB
        return registers[reg.ACCEL_INTEL_CTRL] & 0xC0 == 0xC0

    def watched(self, run: Run, _setup: Setup) -> Run:
        return run

    def restart(self) -> None:
        self._last = None

    def scan(self, accel_g: FloatArray, axes: list[int], _sample_ms: float) -> list[tuple[int, Event]]:
        before = accel_g[:1] if self._last is None else self._last[None]
        self._last = accel_g[-1]
        step_g = np.abs(np.diff(accel_g, axis=0, prepend=before))[:, axes]
        return [(int(i), Event(0, reg.MOT_INT)) for i in np.flatnonzero(np.any(step_g > self._above_g, axis=1))]


def _turns(qualifies: BoolArray, count: int, duration: int, down: int) -> tuple[list[tuple[int, bool]], int]:
    """Where a counter from 0 to `duration` gets there (True) or leaves it (False), and where it stands in the end."""
    if not count and not qualifies.any():
        return [], 0
    found = []
    changes = np.flatnonzero(qualifies[1:] != qualifies[:-1]) + 1
    for begin, end in pairwise([0, *changes.tolist(), len(qualifies)]):
        if qualifies[begin]:
            if count < duration <= count + end - begin:
                found.append((begin + duration - count - 1, True))
            count = min(duration, count + end - begin)
        else:
            if count == duration:
                found.append((begin, False))
            count = max(0, count - down * (end - begin))
    return found, count


def _signs(moved_g: FloatArray, axes: list[int], above_g: float) -> int:
    status = 0
    for axis in axes:
        if moved_g[axis] > above_g:
            status |= _POSITIVE[axis]
        elif moved_g[axis] < -above_g:
            status |= _NEGATIVE[axis]
    return status
