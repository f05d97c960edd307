"""The attitude over a restart: read before the chip is opened, gone on with at its first samples, kept meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Self

from quavelet.core.clock import Clock
from quavelet.core.errors import BusError
from quavelet.imu import Imu
from quavelet.loop.hub import Hub, Policy, SubscriberStats
from quavelet.pipeline import Pipeline
from quavelet.service.host import boot_id
from quavelet.service.keeping import Identity, Keeper, Snapshot, StateFile
from quavelet.service.resume import Resuming, refusal
from quavelet.service.saved_state import NoState, SavedState, digest_of, read_state, state_path
from quavelet.settings import Settings
from quavelet.sinks.message import Message

SUBSCRIBER = "state file"


class Continuity:
    """The state file of one service. All but the writing is done on the loop's thread.

    asleep_ns is CLOCK_BOOTTIME less the time of `clock`.
    """

    def __init__(
        self,
        path: Path,
        *,
        boot: str,
        clock: Clock,
        asleep_ns: Callable[[], int],
        talk: Callable[[str], None],
        policy: Policy,
    ) -> None:
        self.path = path
        self._boot = boot
        self._clock = clock
        self._asleep_ns = asleep_ns
        self._talk = talk
        self._keeper = Keeper()
        self._resuming: Resuming | None = None
        self._is_lost = False
        self._imu: Imu | None = None
        self._identity: Identity | None = None
        self._last: Message | None = None
        self._zero_rad: float | None = None
        self._saved = self._read()
        self.handed_over = 0
        """Copies, and orders to remove the file, given to the thread that writes; `stats` says what it has done."""
        self._copies: Hub[Snapshot | None] = Hub()
        self._copies.subscribe(SUBSCRIBER, StateFile(path, talk=talk), depth=1, policy=policy)

    def around(self, pipeline: Pipeline) -> Resuming:
        """The pipeline, that begins with what was saved where that may be."""
        self._resuming = Resuming(pipeline, self._saved, judge=self._judge, asleep_ns=self._asleep_ns, talk=self._talk)
        return self._resuming

    def attach(self, imu: Imu) -> None:
        """What `around` was called for."""
        self._imu, self._identity = imu, None

    def keep(self, message: Message) -> None:
        """A message has gone out."""
        zero_rad = self._imu.stages.yaw_zero.state().zero_rad if self._imu is not None else None
        if self._saved is not None and self._resuming is not None:
            # What was refused must not be there for the start after this one: it knows less than we do. What was gone
            # on from is good until the board moves.
            self._saved, resumed, self._zero_rad = None, self._resuming.resumed, zero_rad
            self._keeper = Keeper(kept_still=resumed)
            if not resumed:
                self._hand_over(None)
        self._last, self._is_lost = message, False
        if self._keeper.due(message) or zero_rad != self._zero_rad:
            # A zero of yaw that is asked for, or undone, is kept at once.
            self._zero_rad = zero_rad
            self._copy(message)

    def lost(self) -> None:
        """No sample comes any more: who knows what is done to the board meanwhile. May be called again and again."""
        if not self._is_lost and self._last is not None:
            self._last, self._is_lost = None, True
            self._keeper = Keeper()
            self._hand_over(None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        """In good order what is now is kept; a chip that was lost may come back turned, and nothing is."""
        if kind is None and self._last is not None:
            self._copy(self._last)
        self._copies.close()
        if kind is not None:
            with suppress(OSError):
                self.path.unlink()

    def stats(self) -> tuple[SubscriberStats, ...]:
        """What became of the copies."""
        return self._copies.stats()

    def _read(self) -> SavedState | None:
        try:
            return read_state(self.path)
        except NoState as error:
            if str(error):
                self._talk(f"the attitude begins afresh, its state file {self.path} is not used: {error}")
            return None

    def _judge(self, saved: SavedState) -> str:
        who = self._who()
        if who is None:
            return "the chip does not say which it is"
        now_ns = self._clock.now_ns() + self._asleep_ns()
        return refusal(saved, version=who.version, boot_id=who.boot_id, now_ns=now_ns, chip=who.chip, digest=who.digest)

    def _copy(self, message: Message) -> None:
        who = self._who()
        if who is not None and self._imu is not None:
            state = self._imu.pipeline.state()
            self._hand_over(self._keeper.copy(message, state, identity=who, asleep_ns=self._asleep_ns()))

    def _hand_over(self, snapshot: Snapshot | None) -> None:
        self.handed_over += 1
        self._copies.publish(snapshot)

    def _who(self) -> Identity | None:
        """Asked of the chip once; None where it does not answer now."""
        imu = self._imu
        if self._identity is None and imu is not None and imu.source.info is not None:
            try:
                chip = imu.identity(imu.source.info)
            except BusError:
                return None
            digest = digest_of(imu.settings, imu.calibration_text)
            self._identity = Identity(
                version("quavelet"), self._boot, f"{chip.who_am_i:02x}-{chip.fingerprint}", digest
            )
        return self._identity


def continuity_for(
    settings: Settings,
    *,
    name: str,
    environ: Mapping[str, str],
    clock: Clock,
    talk: Callable[[str], None],
    asleep_ns: Callable[[], int],
    policy: Policy,
) -> Continuity | None:
    """The state file that the settings ask for, None where they want none or no start of the machine is known."""
    path, boot = state_path(settings, name=name, environ=environ), boot_id(environ)
    if path is None or not boot:
        return None
    return Continuity(path, boot=boot, clock=clock, asleep_ns=asleep_ns, talk=talk, policy=policy)
