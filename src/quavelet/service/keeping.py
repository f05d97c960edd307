"""Keeping the attitude for a restart: when the loop takes a copy, and the thread that writes it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from quavelet.core.units import NS_PER_S
from quavelet.pipeline import PipelineState
from quavelet.service.saved_state import SavedState, Three, pack_pipeline, write_state
from quavelet.sinks.message import Message

EVERY_NS = 10 * NS_PER_S
SOON_NS = 2 * NS_PER_S
MEAN_OF = 200
"""The mean force and rate follow with this time constant, in messages."""
ENOUGH = 50
"""Messages of a board that is still, before it counts as that."""
_DOUBTS = frozenset(("settling", "stuck", "bias_unknown"))


@dataclass(frozen=True, slots=True)
class Identity:
    """What a state is of, as in `SavedState`."""

    version: str
    boot_id: str
    chip: str
    digest: str


@dataclass(frozen=True, slots=True)
class Snapshot:
    """A copy of all that is kept, not yet packed: that is for the other thread."""

    identity: Identity
    boottime_ns: int
    still: bool
    force_m_s2: Three
    rate_rad_s: Three
    pipeline: PipelineState


class Keeper:
    """Asked by the loop with each message.

    A copy is due every ten seconds, soon after a board has come to rest, and at once when one moves whose file says
    that it is still: after a kill its yaw must not be taken for the one before it moved.

    kept_still   what the file says that is there at the start
    """

    def __init__(self, *, kept_still: bool = False) -> None:
        self.still = False
        self.force_m_s2: Three = (0.0, 0.0, 0.0)
        self.rate_rad_s: Three = (0.0, 0.0, 0.0)
        self._n = 0
        self._kept_ns: int | None = None
        self._kept_still = kept_still

    def due(self, message: Message) -> bool:
        """Take the message in; whether a copy is to be made."""
        still = message.still and not _DOUBTS.intersection(message.flags)
        if not still:
            self._n = 0
        else:
            self._n = min(self._n + 1, MEAN_OF)
            rate = tuple(a + b for a, b in zip(message.gyro_rad_s, message.gyro_bias_rad_s, strict=True))
            self.force_m_s2 = _towards(self.force_m_s2, message.accel_m_s2, self._n)
            self.rate_rad_s = _towards(self.rate_rad_s, (rate[0], rate[1], rate[2]), self._n)
        self.still = self._n >= ENOUGH
        if self._kept_ns is None:
            self._kept_ns = message.t_ns
        since_ns = message.t_ns - self._kept_ns
        if self._kept_still:
            return since_ns >= EVERY_NS or not still
        return since_ns >= (SOON_NS if self.still else EVERY_NS)

    def copy(self, message: Message, pipeline: PipelineState, *, identity: Identity, asleep_ns: int) -> Snapshot:
        """The copy after that message."""
        self._kept_ns, self._kept_still = message.t_ns, self.still
        return Snapshot(identity, message.t_ns + asleep_ns, self.still, self.force_m_s2, self.rate_rad_s, pipeline)


class StateFile:
    """A sink that replaces the file by each copy, and removes it where there is none to be kept.

    A disk that takes none is told once, and tried again each time; the copy before goes too, for it knows nothing of
    what has come since.
    """

    def __init__(self, path: Path, *, talk: Callable[[str], None]) -> None:
        self._path = path
        self._talk = talk
        self._failed = False

    def write(self, snapshot: Snapshot | None) -> None:
        if snapshot is None:
            self._remove()
            return
        who = snapshot.identity
        saved = SavedState(
            version=who.version,
            boot_id=who.boot_id,
            boottime_ns=snapshot.boottime_ns,
            chip=who.chip,
            digest=who.digest,
            still=snapshot.still,
            force_m_s2=snapshot.force_m_s2,
            rate_rad_s=snapshot.rate_rad_s,
            pipeline=pack_pipeline(snapshot.pipeline),
        )
        try:
            write_state(self._path, saved)
        except OSError as error:
            self._remove()
            if not self._failed:
                self._talk(f"the attitude is not kept for a restart: {self._path} cannot be written ({error.strerror})")
            self._failed = True
            return
        if self._failed:
            self._talk(f"the attitude is kept for a restart again, in {self._path}")
        self._failed = False

    def close(self) -> None:
        """Nothing is open."""

    def _remove(self) -> None:
        with suppress(OSError):
            self._path.unlink()


def _towards(mean: Three, value: Three, n: int) -> Three:
    x, y, z = (a + (b - a) / n for a, b in zip(mean, value, strict=True))
    return x, y, z
