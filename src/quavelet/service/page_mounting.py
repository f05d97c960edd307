"""The page's "mounting": is the chip mounted as the settings say?"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import msgspec

from quavelet.calibration.mounting_check import LIFTED_DEG, Held, Judgement, angle_deg, judged, why_not_level
from quavelet.core.blocks import FloatArray
from quavelet.core.errors import NotPossible
from quavelet.core.mounting import Axes
from quavelet.core.units import NS_PER_MS
from quavelet.sinks.message import Message

LOOK_NS = 100 * NS_PER_MS
"""How often the lifted pose is looked for."""
DOUBTS = frozenset(("gap", "stuck", "accel_clipped", "gyro_clipped"))
ASK = {
    "level": "Lay it as it is mounted, level and still, then go on.",
    "nose_up": f"Lift its front by {LIFTED_DEG[0]:.0f} to {LIFTED_DEG[1]:.0f} degrees, and hold it still.",
}
"""The front is where its nose is, and what it rolls about."""

Step = Literal["idle", "level", "nose_up", "done"]


class MountingState(msgspec.Struct, frozen=True, kw_only=True):
    """ask: what is to be done. verdict, says and toml, the lines for the settings: as in `Judgement`, "" before."""

    step: Step
    ask: str
    verdict: str
    says: str
    toml: str


class MountingAbility:
    """ "start", "next" and "stop". Level is taken by "next"; the lifted pose when it is held, or by "next" too.

    axes   of the mounting in force
    """

    def __init__(self, axes: Axes) -> None:
        self._axes = axes
        self._step: Step = "idle"
        self._held = Held()
        self._level: FloatArray | None = None
        self._judgement: Judgement | None = None
        self._looked_ns = 0

    @property
    def name(self) -> str:
        return "mounting"

    def about(self) -> dict[str, dict[str, str]]:
        return {"axes": dict(zip("xyz", self._axes, strict=True))}

    def state(self) -> MountingState:
        found = self._judgement
        return MountingState(
            step=self._step,
            ask=ASK.get(self._step, ""),
            verdict=found.verdict if found else "",
            says=found.says if found else "",
            toml=found.toml if found else "",
        )

    def see(self, message: Message) -> None:
        if self._step not in ("level", "nose_up"):
            return
        if DOUBTS.intersection(message.flags):
            self._held.clear()
            return
        self._held.add(message.t_ns, message.accel_m_s2, message.gyro_rad_s)
        if self._step == "nose_up" and message.t_ns - self._looked_ns >= LOOK_NS:
            self._looked_ns = message.t_ns
            self._look()

    def do(self, what: str, values: Mapping[str, object]) -> str:
        del values
        if what == "start":
            self._go_to("level")
            return ASK["level"]
        if what == "stop":
            self._go_to("idle")
            return "the check is ended"
        if what == "next":
            return self._next()
        raise ValueError('the check is begun by "start", goes on by "next" and is ended by "stop"')

    def close(self) -> None:
        """Nothing is under way that must be ended."""

    def _next(self) -> str:
        up = self._held.up()
        if self._step == "level":
            if up is None:
                raise NotPossible("it was not still for a second: let it lie, then go on")
            why = why_not_level(up, self._axes)
            if why:
                raise NotPossible(why)
            self._go_to("nose_up")
            self._level = up
            return ASK["nose_up"]
        if self._step == "nose_up" and self._level is not None:
            if up is None:
                return self._end(Judgement("unclear", "It was not held still for a second: check again."))
            return self._end(judged(self._level, up, axes=self._axes))
        raise NotPossible("no check is under way: begin with start")

    def _look(self) -> None:
        up = self._held.up()
        if up is None or self._level is None:
            return
        least_deg, most_deg = LIFTED_DEG
        if least_deg <= angle_deg(self._level, up) <= most_deg:
            self._end(judged(self._level, up, axes=self._axes))

    def _end(self, judgement: Judgement) -> str:
        self._go_to("done")
        self._judgement = judgement
        return judgement.says

    def _go_to(self, step: Step) -> None:
        self._step, self._level, self._judgement = step, None, None
        self._held.clear()
