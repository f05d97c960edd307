"""Playing a recording: from anywhere, at any speed, with pauses; what is given is what a straight replay gives."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from quavelet.core.blocks import AttitudeBlock, RawBlock
from quavelet.core.clock import Clock
from quavelet.core.errors import ImuError
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050.stream import StreamInfo
from quavelet.pipeline import Pipeline
from quavelet.recording.checkpoint import Checkpoints, Replaying
from quavelet.recording.first_pass import TOGETHER, FirstPass
from quavelet.recording.overview import Overview
from quavelet.recording.reader import RecordingReader

LEAD_NS = 10 * NS_PER_S
"""What a viewer is shown of the time before the one he went to."""
LEAD_STEP_NS = 100 * NS_PER_MS
SLOWEST, FASTEST = 0.1, 100.0
TOGETHER_NS = 5 * NS_PER_MS
"""Drains due within so much of the clock's time are given as one block."""
LOOK_NS = 20 * NS_PER_MS
"""How often it is looked whether something else is wanted."""
LATE_NS = NS_PER_S
"""What it is later than that is never caught up: the recording is more than this machine can do at that speed."""


@dataclass(frozen=True, slots=True)
class Played:
    """What is given next.

    attitude   at least one row: that of one drain, of several where it is played fast
    src        the bus it was recorded from
    before     None where it follows what was given last; else time has jumped, and this is what came before it, some
               seconds of it, each block of 0.1 s, oldest first
    """

    attitude: AttitudeBlock
    src: str
    before: tuple[AttitudeBlock, ...] | None = None


@dataclass(frozen=True, slots=True)
class PlayerState:
    """How it stands; times in recorded seconds since the first drain.

    length_s   guessed until all of it is known
    known_s    up to here it is known, and can be gone to at once
    wanted_s   where it is to go as soon as that is known, None where nothing is waited for
    speed      recorded time per time of the clock
    ended      it stands at the end
    says       what is wrong with the file, "" while nothing is known to be
    """

    t_s: float
    length_s: float
    known_s: float
    wanted_s: float | None
    speed: float
    paused: bool
    ended: bool
    says: str


class Player:
    """Plays the recording `path` from its beginning, until it is closed.

    give           takes what is played, on the player's thread; may be set until it is started
    make_pipeline  a pipeline in its first state, always of the same settings
    lead_ns        so much of the time before it is given with the time that was sought

    All methods return at once and may be called from any thread. Raises RecordingError where there is no recording.
    `start` begins two threads: one plays, one goes through the whole file first. Without it `step` does what the one
    would, and `first_pass.step` what the other.
    """

    def __init__(
        self,
        path: Path,
        *,
        make_pipeline: Callable[[], Pipeline],
        clock: Clock,
        give: Callable[[Played], None] = lambda _: None,
        checkpoints: Checkpoints | None = None,
        lead_ns: int = LEAD_NS,
    ) -> None:
        self.first_pass = FirstPass(RecordingReader(path), make_pipeline=make_pipeline, checkpoints=checkpoints)
        self.path = path
        self.failure: BaseException | None = None
        self._replaying = Replaying(RecordingReader(path), make_pipeline=make_pipeline)
        self._clock = clock
        self._lead_ns = lead_ns
        self.give = give
        self._lock = threading.Lock()
        self._wanted_ns: int | None = None
        self._paused = False
        self._speed = 1.0
        # From here on only the player's thread changes anything.
        self._in_hand: RawBlock | None = None
        self._done_ns = self._played_ns = 0
        self._ended = False
        self._says = ""
        self._before: tuple[AttitudeBlock, ...] | None = None
        self._origin: tuple[int, int, float] | None = None
        self._stopped = threading.Event()
        self._threads = [
            threading.Thread(target=self._run, name="player", daemon=True),
            threading.Thread(target=self._go_through, name="first pass", daemon=True),
        ]

    @property
    def health(self) -> Health:
        """All counters up to where it is."""
        return self._replaying.health

    @property
    def info(self) -> StreamInfo:
        """The chip where it is."""
        return self._replaying.source.info

    @property
    def measured_rate_hz(self) -> float | None:
        """The chip's sample rate where it is, None until it is measured."""
        return self._replaying.source.decoder.measured_rate_hz

    def state(self) -> PlayerState:
        with self._lock:
            wanted_ns, paused, speed = self._wanted_ns, self._paused, self._speed
        known_ns, length_ns = self.first_pass.known_ns, self.first_pass.length_ns
        return PlayerState(
            t_s=self._played_ns / NS_PER_S,
            length_s=max(length_ns, known_ns, self._played_ns) / NS_PER_S,
            known_s=known_ns / NS_PER_S,
            wanted_s=None if wanted_ns is None else wanted_ns / NS_PER_S,
            speed=speed,
            paused=paused,
            ended=self._ended and wanted_ns is None,
            says=self._says or self.first_pass.says,
        )

    def overview(self) -> Overview:
        """The recording from afar, as far as it is known."""
        return self.first_pass.overview()

    def pause(self) -> None:
        with self._lock:
            self._paused = True

    def resume(self) -> None:
        with self._lock:
            self._paused = False

    def seek(self, t_s: float) -> None:
        """Go on from the recorded time `t_s`; from the end where that is beyond it, from the beginning where it is
        below 0. Raises ValueError where it is no time."""
        if not isfinite(t_s):
            raise ValueError(f"{t_s} is no time: give seconds from the beginning")
        # So far no file reaches; an integer of any length is none the less one of 64 bits then.
        bounded_s = min(max(t_s, 0.0), 1e9)
        with self._lock:
            self._wanted_ns = round(bounded_s * NS_PER_S)

    def set_speed(self, speed: float) -> None:
        """Recorded time per time of the clock. Raises ValueError for what is not from 0.1 to 100."""
        if not SLOWEST <= speed <= FASTEST:
            raise ValueError(f"a speed of {speed} does not fit: give one from {SLOWEST:g} to {FASTEST:g}")
        with self._lock:
            self._speed = float(speed)

    def start(self) -> None:
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Stop; what is being given is waited for."""
        self._stopped.set()
        for thread in self._threads:
            if thread.is_alive() and thread is not threading.current_thread():
                thread.join()

    def step(self) -> None:
        """Do one thing: go where it was told to, give what is due, or wait a little."""
        with self._lock:
            wanted_ns, paused, speed = self._wanted_ns, self._paused, self._speed
        if wanted_ns is not None:
            self._go_to(wanted_ns)
        elif paused or self._ended:
            self._origin = None
            self._wait_a_little()
        else:
            self._play(speed)

    def _play(self, speed: float) -> None:
        """Give what is due at this speed, or wait for it, but not for long."""
        raw = self._next()
        if raw is None:
            return
        now_ns, at_ns = self._clock.now_ns(), self._replaying.at_ns
        if self._origin is None or self._origin[2] != speed:
            self._origin = (self._played_ns, now_ns, speed)
        due_ns = self._origin[1] + round((at_ns - self._origin[0]) / speed)
        if now_ns - due_ns > LATE_NS:
            self._origin = (at_ns, now_ns, speed)
        if now_ns < due_ns:
            self._clock.sleep_until_ns(min(due_ns, now_ns + LOOK_NS))
            gone_ns = round((self._clock.now_ns() - self._origin[1]) * speed)
            self._played_ns = min(at_ns, max(self._played_ns, self._origin[0] + gone_ns))
            return
        attitude = self._group(at_ns + round(TOGETHER_NS * speed))
        self._played_ns = self._done_ns
        self._present(attitude)

    def _group(self, end_ns: int) -> AttitudeBlock | None:
        """`_drains`, through the pipeline."""
        return self._replaying.process(self._drains(end_ns))

    def _drains(self, end_ns: int) -> list[RawBlock]:
        """The drain in hand and those behind it up to recorded time `end_ns`, not too many at once."""
        blocks = list[RawBlock]()
        while (raw := self._next()) is not None and (not blocks or self._replaying.at_ns < end_ns):
            self._done_ns = self._replaying.at_ns
            blocks.append(raw)
            self._in_hand = None
            if len(blocks) == TOGETHER:
                break
        return blocks

    def _next(self) -> RawBlock | None:
        """The drain in hand, or the next one; None at the end."""
        if self._in_hand is None and not self._ended:
            try:
                self._in_hand = self._replaying.read()
            except ImuError as error:
                self._says = str(error)
            self._ended = self._in_hand is None
        return self._in_hand

    def _go_to(self, wanted_ns: int) -> None:
        """Go to the recorded time `wanted_ns`, or wait a little for the first pass to come there."""
        first_pass = self.first_pass
        from_ns = max(0, min(wanted_ns, first_pass.length_ns if first_pass.done else wanted_ns) - self._lead_ns)
        if not first_pass.done and first_pass.known_ns < from_ns:
            self._wait_a_little()
            return
        self._replaying.go_on_from(first_pass.before(from_ns))
        self._in_hand, self._ended, self._origin = None, False, None
        self._done_ns = self._replaying.at_ns
        while self._reaches(from_ns) and self._still(wanted_ns):
            self._group(from_ns)
        lead = list[AttitudeBlock]()
        last = self._replaying.last
        while self._reaches(wanted_ns + 1) and self._still(wanted_ns):
            at_ns = self._replaying.at_ns
            end_ns = min(wanted_ns + 1, (at_ns // LEAD_STEP_NS + 1) * LEAD_STEP_NS)
            drains = self._drains(end_ns)
            # The last of all by itself, as in a straight replay, where no drain shares its flags with those before it.
            alone = end_ns > wanted_ns or not self._reaches(wanted_ns + 1)
            for some in [[one] for one in drains] if alone else [drains]:
                attitude = self._replaying.process(some)
                if attitude is not None:
                    lead.append(attitude)
        if not self._still(wanted_ns):
            return
        self._arrive(wanted_ns, lead, last)

    def _arrive(self, wanted_ns: int, lead: list[AttitudeBlock], last: AttitudeBlock | None) -> None:
        """Give the last of what came before, so that it is to be seen also while paused."""
        with self._lock:
            if self._wanted_ns != wanted_ns:
                return
            self._wanted_ns = None
        self._played_ns = self._done_ns if self._ended else wanted_ns
        newest = lead.pop() if lead else last
        self._before = tuple(lead)
        self._present(newest)

    def _present(self, attitude: AttitudeBlock | None) -> None:
        if attitude is None:
            return
        before, self._before = self._before, None
        self.give(Played(attitude, self.info.src, before))

    def _reaches(self, end_ns: int) -> bool:
        """Whether there is a drain before the recorded time `end_ns`."""
        return self._next() is not None and self._replaying.at_ns < end_ns

    def _still(self, wanted_ns: int) -> bool:
        """Whether it is still to go there."""
        return self._wanted_ns == wanted_ns and not self._stopped.is_set()

    def _wait_a_little(self) -> None:
        self._clock.sleep_until_ns(self._clock.now_ns() + LOOK_NS)

    def _run(self) -> None:
        self._kept(lambda: self._until_stopped(self.step))

    def _go_through(self) -> None:
        self._kept(lambda: self.first_pass.run(self._stopped.is_set))

    def _until_stopped(self, step: Callable[[], None]) -> None:
        while not self._stopped.is_set():
            step()

    def _kept(self, work: Callable[[], None]) -> None:
        """Keep why a thread ended that should not have, for who started it."""
        try:
            work()
        except BaseException as error:
            self.failure = error
            raise
