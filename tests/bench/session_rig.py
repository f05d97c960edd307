"""A bench session on the fake board, in virtual time, with an operator that a test can make clumsy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from hw_fakes.wire.bench import BenchBus
from quavelet.bench.session import Session, View
from quavelet.bench.session_conduct import LOOKS_HZ, conduct
from quavelet.bench.session_evidence import Chip, Evidence
from quavelet.bench.session_store import SessionStore
from quavelet.calibration.record import ChipIdentity
from quavelet.core.clock import VirtualClock
from quavelet.core.health import Health
from quavelet.core.instruction import Instruction
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050.magnetometer.asked import MagnetometerParams
from quavelet.mpu6050.source import ChipSource
from quavelet.settings import Settings

SETTINGS = Settings()


class Bench:
    """One board, one session on it, and the operator: it follows each instruction as `hears` has changed it.

    notices   what the person was told, in order, each once in a row
    """

    def __init__(
        self,
        names: Sequence[str],
        *,
        out: Path,
        seed: int = 1,
        evidence: Evidence | None = None,
        hears: Callable[[Instruction], Instruction] = lambda told: told,
        each_look: Callable[[Bench], None] = lambda _bench: None,
    ) -> None:
        self.clock = VirtualClock(5 * NS_PER_S)
        self.bus = BenchBus(clock=self.clock, seed=seed)
        self.source = ChipSource(
            self.bus,
            address=0x68,
            config=SETTINGS.chip,
            clock=self.clock,
            health=Health(),
            magnetometer=MagnetometerParams(use="auto" if "magnetometer" in names else "no"),
        )
        info = self.source.wait_until_streaming()
        self.chip = Chip(
            identity=ChipIdentity(who_am_i=info.who_am_i, name=info.variant.name, bus=self.bus.name, address=0x68),
            gyro_range_dps=SETTINGS.chip.gyro_range_dps,
            accel_range_g=SETTINGS.chip.accel_range_g,
            scale=info.scale,
        )
        self.session = Session(names, Evidence(chip=self.chip) if evidence is None else evidence)
        self.store = SessionStore(out)
        self.notices: list[str] = []
        self.views: list[View] = []
        self._hears = hears
        self._each_look = each_look

    @property
    def evidence(self) -> Evidence:
        return self.session.evidence

    @property
    def s(self) -> float:
        """Seconds of the bench."""
        return self.clock.now_ns() / NS_PER_S

    def ask(self, instruction: Instruction) -> None:
        self.bus.follow(self._hears(instruction))

    def show(self, view: View) -> None:
        self.views.append(view)
        if view.notice and self.notices[-1:] != [view.notice]:
            self.notices.append(view.notice)
        self._each_look(self)

    def conduct(
        self, *, stopped: Callable[[], bool] = lambda: False, patience_s: float = 600.0, looks_hz: float = LOOKS_HZ
    ) -> bool:
        return conduct(
            self.session,
            self.source,
            settings=SETTINGS,
            clock=self.clock,
            operator=self,
            store=self.store,
            stopped=stopped,
            patience_s=patience_s,
            looks_hz=looks_hz,
        )
