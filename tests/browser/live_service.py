"""A service on a fake chip in a thread of the test, whose truth is at hand; and the program."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from hw_fakes import NOISE_ONLY, FakeBus, FakeMpu6050, Motion, Show
from hw_fakes.faults.plan import parse
from hw_fakes.world.motion_show import Move
from quavelet.cli.demo import of_a_fake
from quavelet.core.clock import VirtualClock
from quavelet.core.units import NS_PER_S
from quavelet.service.service import Service
from quavelet.settings import BusSettings, Settings
from quavelet.settings.web import WebSettings

URL = re.compile(r"the page is at (http://\S+)")
START_NS = NS_PER_S
"""When a recording begins."""
# The program of this very tree.
PROGRAM = (sys.executable, "-c", "from quavelet.cli.app import main; main()")


def live_motion() -> Show:
    """At rest while the service begins, then turned about all axes at once and swayed, for ever."""
    moves = Move(35, -25, 80, 1.2, 0.2), Move(-35, 30, -60, 1.6, 0.2), Move(0, 0, 0, 1.2, 0.4)
    return Show(start_s=5.0, moves=moves, sway_s=3.0, rest_s=1.0)


def record(path: Path, motion: Motion, *, length_s: float, fault: str = "") -> FakeBus:
    """A recording of that length, made in virtual time; the bus knows its truth. fault: one, as "eio n=5 at=3"."""
    clock = VirtualClock(START_NS)
    chip = FakeMpu6050(clock, motion=motion, imperfections=NOISE_ONLY, seed=1)
    bus = FakeBus({0x68: chip}, clock=clock, name="fake:show")
    if fault:
        bus.adapter.faults.add(parse(fault))
    service = Service(
        Settings(bus=BusSettings(name="fake:show")),
        clock=clock,
        talk=lambda _text: None,
        record=path,
        realtime=False,
        opened=lambda _name, _clock: bus,
    )
    service.run(until_ns=clock.now_ns() + round(length_s * NS_PER_S))
    return bus


class PacedClock(VirtualClock):
    """CLOCK_MONOTONIC where the machine keeps up; where it does not, time goes on later and nothing is lost by that.

    What is measured of the page is then not that of a loop without priority on a machine full of browsers.
    """

    def __init__(self) -> None:
        super().__init__(time.monotonic_ns())

    def sleep_until_ns(self, t_ns: int) -> None:
        time.sleep(max(0, t_ns - time.monotonic_ns()) / NS_PER_S)
        super().sleep_until_ns(t_ns)


class LiveService:
    """Runs while it is open; `url` is where its page is."""

    def __init__(self, motion: Motion, *, listen: str = "127.0.0.1:0", recordings: str = "", **web: Any) -> None:
        clock = PacedClock()
        chip = FakeMpu6050(clock, motion=motion, imperfections=NOISE_ONLY, seed=1)
        self.bus = FakeBus({0x68: chip}, clock=clock, name="fake:show")
        self.said: list[str] = []
        self.url = ""
        self.error: BaseException | None = None
        self._listens = threading.Event()
        self._thread = threading.Thread(target=self._run, name="service")
        self.service = Service(
            Settings(bus=BusSettings(name="fake:show"), web=WebSettings(listen=listen, recordings=recordings, **web)),
            clock=clock,
            talk=self._talk,
            # No real-time priority for a process of tests.
            realtime=False,
            opened=lambda _name, _clock: self.bus,
        )
        # As in a demo: faults, and a calibration.
        self.service.abilities.extend(of_a_fake(self.service))

    def __enter__(self) -> LiveService:
        self._thread.start()
        assert self._listens.wait(20), (self.said, self.error)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.service.stop()
        self._thread.join(20)
        assert not self._thread.is_alive()
        if self.error is not None:
            raise self.error

    def truth(self, t_ns: np.ndarray[Any, np.dtype[np.int64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
        """(N, 4) at the times (N,), as the fake moves; its yaw begins at 0, as that of the service does."""
        return self.bus.attitude(t_ns)

    def _run(self) -> None:
        try:
            self.service.run()
        except BaseException as error:  # noqa: BLE001
            self.error = error

    def _talk(self, text: str) -> None:
        self.said.append(text)
        where = URL.search(text)
        if where:
            self.url = where[1]
            self._listens.set()


class Program:
    """`quavelet ARGUMENTS` while it is open; `url` is where it says that its page is."""

    def __init__(self, *arguments: object, cwd: Path) -> None:
        # Python puts the folder it is started in on its path, and that is to be the recordings' one here.
        env = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "STATE_DIRECTORY": ""}
        self.said: list[str] = []
        self.url = ""
        self._listens = threading.Event()
        self._process = subprocess.Popen(
            [*PROGRAM, *map(str, arguments)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            env=env,
            cwd=cwd,
        )
        self._thread = threading.Thread(target=self._hear, daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        return int(self.url.split("#")[0].rstrip("/").rpartition(":")[2])

    def __enter__(self) -> Program:
        if not self._listens.wait(30) or not self.url:
            self.kill()
            raise AssertionError(self.said)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end(signal.SIGTERM)

    def kill(self) -> None:
        """As the machine does that loses its supply."""
        self._end(signal.SIGKILL)

    def _end(self, how: signal.Signals) -> None:
        self._process.send_signal(how)
        self._process.wait(30)
        self._thread.join(10)
        if self._process.stderr is not None:
            self._process.stderr.close()

    def _hear(self) -> None:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            self.said.append(line.rstrip())
            where = URL.search(line)
            if where:
                self.url = where[1]
                self._listens.set()
        self._listens.set()
