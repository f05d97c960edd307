"""The ability "calibrate": the bench session on a fake board, to be watched from the page."""

from __future__ import annotations

import threading
from collections.abc import Mapping

import msgspec

from quavelet.bench.finding import Finding
from quavelet.bench.session import KINDS, USUAL, View, with_check
from quavelet.bench.session_paced import PacedSession
from quavelet.bench.session_watch import Seen
from quavelet.bench.session_words import in_words
from quavelet.core.errors import ImuError, SettingsError
from quavelet.core.mounting import called
from quavelet.sinks.message import Four, Message

SPEED = 8.0
"""The usual session takes about a minute then."""
NOT_KEPT = "nothing is kept: this board is not real"
CLOSE_S = 0.9


class StepTold(msgspec.Struct, frozen=True, kw_only=True):
    """usual: whether it is done where no steps are named; progress from 0 to 1."""

    name: str
    title: str
    usual: bool
    progress: float = 0.0


class CalibrateAbout(msgspec.Struct, frozen=True, kw_only=True):
    """The steps there are, in their order."""

    steps: tuple[StepTold, ...]
    bus: str
    speed: float


class ViewTold(msgspec.Struct, frozen=True, kw_only=True):
    """What somebody at the bench would see; see `View` and `Seen`. instruction is a sentence, "" once all is measured;
    face and asked_face are axes in words, None and "" for none."""

    steps: tuple[StepTold, ...]
    at: int
    status: str
    instruction: str
    notice: str
    face: str | None
    asked_face: str
    still_s: float
    needs_s: float
    turned_deg: float
    temp_degc: float


class LineTold(msgspec.Struct, frozen=True, kw_only=True):
    """level: "good", "warn" for a note, "bad"; title is what was looked at, text what was found and what to do."""

    level: str
    title: str
    text: str


class ResultTold(msgspec.Struct, frozen=True, kw_only=True):
    """verdict: "good" or "bad"; the last of the lines is the verdict in words."""

    verdict: str
    lines: tuple[LineTold, ...]


class CalibrateState(msgspec.Struct, frozen=True, kw_only=True):
    """view: None before the first samples; why: what ended the session before its end, "" where nothing did."""

    running: bool
    speed: float
    view: ViewTold | None = None
    q: Four | None = None
    result: ResultTold | None = None
    why: str = ""


class CalibratePage:
    """An `Ability`. One session at a time, on a thread of its own.

    bus     the name of one whose board moves by itself, "fake:bench"
    speed   how many times as fast as real its time goes
    """

    name = "calibrate"

    def __init__(self, *, bus: str = "fake:bench", speed: float = SPEED) -> None:
        self._bus = bus
        self._speed = speed
        self._session: PacedSession | None = None
        self._thread: threading.Thread | None = None
        self._result: ResultTold | None = None
        self._why = ""
        self._closed = False

    @property
    def running(self) -> bool:
        """Whether a session is under way."""
        return self._thread is not None and self._thread.is_alive()

    def about(self) -> CalibrateAbout:
        steps = tuple(StepTold(name=kind.name, title=kind.title, usual=kind.name in USUAL) for kind in KINDS)
        return CalibrateAbout(steps=steps, bus=self._bus, speed=self._speed)

    def state(self) -> CalibrateState:
        session = self._session
        view = session.view if session else None
        return CalibrateState(
            running=self.running,
            speed=self._speed,
            view=_told(view, view.seen) if view and view.seen else None,
            q=session.q if session else None,
            result=self._result,
            why=self._why,
        )

    def see(self, message: Message) -> None:
        """The session is on a board of its own."""

    def do(self, what: str, values: Mapping[str, object]) -> str:
        """ "start" with some `steps`, or none for the usual ones; "stop". Raises SettingsError."""
        if what == "start":
            return self._start(values.get("steps"))
        if what == "stop":
            if not self.running or self._session is None:
                raise SettingsError("there is no calibration under way: start one")
            self._session.stop()
            return "the calibration is stopped"
        raise SettingsError("a calibration can be started and stopped, and no more: ask for start or stop")

    def close(self) -> None:
        self._closed = True
        if self._session is not None:
            self._session.stop()
        if self._thread is not None:
            self._thread.join(CLOSE_S)

    def _start(self, steps: object) -> str:
        if self.running or self._closed:
            raise SettingsError("a calibration is under way: stop it first")
        names = list(USUAL) if steps is None else _names(steps)
        session = PacedSession(with_check(names), bus=self._bus, speed=self._speed)
        self._session, self._result, self._why = session, None, ""
        self._thread = threading.Thread(target=self._run, args=(session,), name="calibrate", daemon=True)
        self._thread.start()
        return f"the calibration begins, {self._speed:g} times as fast as on a bench; {NOT_KEPT}"

    def _run(self, session: PacedSession) -> None:
        try:
            findings = session.run()
        except (ImuError, OSError) as error:
            self._why = str(error)
            self._result = ResultTold(verdict="bad", lines=(LineTold(level="bad", title="verdict", text=self._why),))
            return
        if findings is None:
            self._why = "stopped before its end"
            return
        good = all(finding.ok for finding in findings)
        word = f"{'good' if good else 'not good enough'}; {NOT_KEPT}"
        last = LineTold(level="good" if good else "bad", title="verdict", text=word)
        lines = (*(_line(finding) for finding in findings), last)
        self._result = ResultTold(verdict=last.level, lines=lines)


def _names(steps: object) -> list[str]:
    if not isinstance(steps, list) or not steps or not all(isinstance(name, str) for name in steps):
        raise SettingsError(f"steps are a list of some of {', '.join(kind.name for kind in KINDS)}")
    return steps


def _line(finding: Finding) -> LineTold:
    level = "bad" if not finding.ok else "warn" if finding.advice else "good"
    text = f"{finding.found}; {finding.advice}" if finding.advice else finding.found
    return LineTold(level=level, title=finding.name, text=text)


def _told(view: View, seen: Seen) -> ViewTold:
    asked = view.instruction
    return ViewTold(
        steps=tuple(
            StepTold(name=name, title=title, usual=name in USUAL, progress=round(progress, 3))
            for name, title, progress in view.steps
        ),
        at=view.at,
        status=view.status,
        instruction=in_words(asked, view.axes) if asked else "",
        notice=view.notice,
        face=called(seen.face, view.axes) if seen.face else None,
        asked_face=called(asked.face, view.axes) if asked and asked.face else "",
        still_s=round(seen.still_s, 1),
        needs_s=view.needs_s,
        turned_deg=round(seen.turned_deg, 1),
        temp_degc=round(seen.temp_degc, 2),
    )
