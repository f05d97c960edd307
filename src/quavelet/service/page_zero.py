"""The page's "zero": yaw counts from where the board is."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import msgspec

from quavelet.core.errors import NotPossible
from quavelet.core.units import DEG_PER_RAD
from quavelet.imu import Imu
from quavelet.sinks.message import Message


class ZeroState(msgspec.Struct, frozen=True, kw_only=True):
    """possible: yaw can be set to zero; why: the reason where it cannot. zeroed_deg: the yaw that reads zero, None
    where it counts from the start."""

    possible: bool
    why: str
    zeroed_deg: float | None


class ZeroAbility:
    """ "now" and "undo". `imu` gives the chip, None while there is none."""

    name = "zero"

    def __init__(self, imu: Callable[[], Imu | None]) -> None:
        self._imu = imu

    def about(self) -> None:
        return None

    def state(self) -> ZeroState:
        imu = self._imu()
        why = "there is no chip yet: wait for it" if imu is None else imu.stages.yaw_zero.refusal
        zero_rad = imu.stages.yaw_zero.state().zero_rad if imu else None
        return ZeroState(
            possible=not why, why=why, zeroed_deg=None if zero_rad is None else round(DEG_PER_RAD * zero_rad, 2)
        )

    def see(self, message: Message) -> None:
        """The pipeline itself is asked."""

    def do(self, what: str, values: Mapping[str, object]) -> str:
        del values
        imu = self._imu()
        if imu is None:
            raise NotPossible("there is no chip yet: wait for it")
        if what == "now":
            imu.zero_yaw()
            return "yaw counts from here"
        if what == "undo":
            imu.undo_zero_yaw()
            return "yaw counts from the start again"
        raise ValueError('yaw can be set to zero by "now", and that taken back by "undo"')

    def close(self) -> None:
        """A zero stays."""
