"""A whole bench session on a fake board, for somebody who looks on: led through by itself, faster than real time."""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from quavelet.bench.finding import Finding
from quavelet.bench.session import Session, View
from quavelet.bench.session_conduct import conduct
from quavelet.bench.session_evidence import Chip, Evidence
from quavelet.bench.session_older import work_out_over
from quavelet.bench.session_store import SessionStore
from quavelet.bench.session_verdict import verdict
from quavelet.bus.open import open_bus
from quavelet.bus.protocol import FollowsInstructions, I2CBus
from quavelet.calibration.record import ChipIdentity
from quavelet.calibration.record_file import save_record
from quavelet.core.blocks import RawBlock
from quavelet.core.clock import Clock, VirtualClock
from quavelet.core.errors import SettingsError
from quavelet.core.health import Health
from quavelet.core.instruction import Instruction
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.fingerprint import fingerprint_of
from quavelet.mpu6050.magnetometer.asked import MagnetometerParams
from quavelet.mpu6050.source import ChipSource
from quavelet.pipeline import Pipeline, build_pipeline
from quavelet.settings import BusSettings, Settings
from quavelet.sinks.message import Four

STEP_S = 0.02
"""It sleeps no longer at a time, by a real clock."""
PATIENCE_S = 1800.0
LOOKS_HZ = 8.0
"""Of its own time, which is many times as fast: nobody could see more, and the loop beside it needs the processor."""


class PacedClock(VirtualClock):
    """A virtual clock whose sleeps take their time, `speed` times as short: it never runs ahead of that.

    A host that is too slow for it makes it slower, and no sample is lost. Once `stopped` is set, no sleep takes time.
    """

    def __init__(self, *, speed: float, stopped: threading.Event) -> None:
        super().__init__()
        if not speed > 0:
            raise ValueError(f"speed {speed} must be above 0: time goes on")
        self._speed = speed
        self._stopped = stopped
        self._began_s = time.monotonic()

    def sleep_until_ns(self, t_ns: int) -> None:
        due_s = self._began_s + t_ns / NS_PER_S / self._speed
        rest_s = due_s - time.monotonic()
        if rest_s < 0:
            # What is lost is not made up for by haste.
            self._began_s -= rest_s
        # Shorter ones are left to the next sleep: most are of a few ms.
        while rest_s > STEP_S / 4 and not self._stopped.wait(min(rest_s, STEP_S)):
            rest_s = due_s - time.monotonic()
        super().sleep_until_ns(t_ns)


class PacedSession:
    """One session from its beginning to the verdict. `run` is for a thread of its own, all else may be asked on any.

    view   the newest, None before the first
    q      of the board, body to world, by a pipeline on the same samples; None before the first

    bus     the name of one whose board moves by itself
    opened  opens the bus
    """

    def __init__(
        self,
        names: Sequence[str],
        *,
        bus: str,
        speed: float,
        opened: Callable[[str, Clock], I2CBus] = lambda name, clock: open_bus(name, clock=clock),
    ) -> None:
        self.view: View | None = None
        self.q: Four | None = None
        self._names = tuple(names)
        self._stopped = threading.Event()
        self._clock = PacedClock(speed=speed, stopped=self._stopped)
        magnetometer = MagnetometerParams(use="auto" if "magnetometer" in names else "no")
        self._settings = Settings(bus=BusSettings(name=bus), magnetometer=magnetometer)
        self._opened = opened
        self._bus: FollowsInstructions | None = None

    def stop(self) -> None:
        """End it at the next look."""
        self._stopped.set()

    def run(self) -> list[Finding] | None:
        """The findings, and the calibration is saved where nobody finds it; None where it was stopped. Raises ImuError.

        Raises SettingsError for a bus whose board does not move by itself.
        """
        with tempfile.TemporaryDirectory(prefix="quavelet-") as folder:
            out = Path(folder) / "calibration.toml"
            with self._opened(self._settings.bus.name, self._clock) as bus:
                if not isinstance(bus, FollowsInstructions):
                    raise SettingsError(f"nobody moves the board of {bus.name}: take fake:bench")
                self._bus = bus
                evidence = self._conduct(bus, out)
            if evidence is None:
                return None
            result = work_out_over(evidence, out, even_if_worse=True, tell=lambda _text: None)
            if result.merged.fresh:
                save_record(result.record, out, even_if_worse=True)
            return verdict(result)

    def ask(self, instruction: Instruction) -> None:
        """As `conduct` has it."""
        assert self._bus is not None, "opened by run"
        self._bus.follow(instruction)

    def show(self, view: View) -> None:
        """As `conduct` has it."""
        self.view = view

    def _conduct(self, bus: I2CBus, out: Path) -> Evidence | None:
        settings, clock = self._settings, self._clock
        source = ChipSource(
            bus,
            address=settings.bus.address,
            config=settings.chip,
            magnetometer=settings.magnetometer,
            clock=clock,
            health=Health(),
        )
        info = source.wait_until_streaming()
        access = RegisterAccess(bus, address=settings.bus.address, clock=clock, health=Health())
        identity = ChipIdentity(
            who_am_i=info.who_am_i,
            name=info.variant.name,
            bus=bus.name,
            address=settings.bus.address,
            fingerprint=fingerprint_of(access, variant=info.variant),
        )
        chip = Chip(
            identity=identity,
            gyro_range_dps=info.gyro_range_dps,
            accel_range_g=info.accel_range_g,
            scale=info.scale,
        )
        session = Session(self._names, Evidence(chip=chip))
        finished = conduct(
            session,
            _Shown(source, build_pipeline(settings), self._take),
            settings=settings,
            clock=clock,
            operator=self,
            store=SessionStore(out),
            stopped=self._stopped.is_set,
            patience_s=PATIENCE_S,
            looks_hz=LOOKS_HZ,
        )
        return session.evidence if finished else None

    def _take(self, q: Four) -> None:
        self.q = q


class _Shown:
    """A source whose samples go through a pipeline as well."""

    def __init__(self, source: ChipSource, pipeline: Pipeline, take: Callable[[Four], None]) -> None:
        self._source = source
        self._pipeline = pipeline
        self._take = take

    def read(self) -> RawBlock:
        raw = self._source.read()
        block = self._pipeline.process(raw)
        if len(block):
            w, x, y, z = block.q[-1].tolist()
            self._take((w, x, y, z))
        return raw
