"""`quavelet demo --web` as a visitor has it: the program, its page over a socket, and its end."""

from __future__ import annotations

import asyncio
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import pytest
from program import NOISE, PROGRAM, quavelet

aiohttp = pytest.importorskip("aiohttp")

WHERE = re.compile(r"the page is at (http://127\.0\.0\.1:\d+/)")
PATIENCE_S = 60.0
"""On a machine so busy that the loop comes late, a fault is followed for 30 s."""


class Demo:
    """The program with its page; `end` stops it as Ctrl-C does."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self._found = threading.Event()
        self.program = subprocess.Popen(
            [PROGRAM, "demo", "--web", "--port", "0"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        self._reader = threading.Thread(target=self._read)
        self._reader.start()
        assert self._found.wait(PATIENCE_S), self.said

    @property
    def where(self) -> str:
        return next(found[1] for line in self.said if (found := WHERE.search(line)))

    def end(self) -> float:
        """How long it took."""
        before = time.monotonic()
        self.program.send_signal(signal.SIGINT)
        self.program.wait(PATIENCE_S)
        took_s = time.monotonic() - before
        self._reader.join(PATIENCE_S)
        return took_s

    def _read(self) -> None:
        assert self.program.stderr is not None
        with self.program.stderr as lines:
            for line in lines:
                self.said.append(line.rstrip())
                if WHERE.search(line):
                    self._found.set()


@pytest.fixture
def demo() -> Iterator[Demo]:
    demo = Demo()
    yield demo
    if demo.program.poll() is None:
        demo.program.kill()
        demo.program.wait()


class Visitor:
    """One viewer: the newest frame of each kind, and of each ability its state."""

    def __init__(self, socket: Any) -> None:
        self._socket = socket
        self._asked = 0
        self.newest: dict[str, Any] = {}

    async def until(self, there: Callable[[dict[str, Any]], Any]) -> Any:
        async with asyncio.timeout(PATIENCE_S):
            while not (found := self.newest and there(self.newest)):
                frame = msgspec.json.decode((await self._socket.receive()).data)
                name = frame["name"] if frame["is"] == "ability" else frame["is"]
                self.newest[name] = frame["state"] if frame["is"] == "ability" else frame
        return found

    async def ask(self, ability: str, what: str, **values: object) -> tuple[bool, str]:
        self._asked += 1
        asked = {"n": self._asked, "ability": ability, "what": what, "values": values}
        await self._socket.send_str(msgspec.json.encode(asked).decode())
        answer = await self.until(lambda new: new.get("answer", {}).get("n") == self._asked and new["answer"])
        return answer["ok"], answer["text"]


def visit(demo: Demo, what: Callable[[Visitor], Any]) -> None:
    async def there() -> None:
        origin = {"Origin": demo.where.rstrip("/")}
        async with aiohttp.ClientSession() as session, session.ws_connect(demo.where + "live", headers=origin) as live:
            await what(Visitor(live))

    asyncio.run(there())


def test_a_visitor_breaks_the_chip_watches_a_calibration_and_the_program_ends_at_once(demo: Demo) -> None:
    async def look(visitor: Visitor) -> None:
        hello = await visitor.until(lambda new: "message" in new and new["hello"])
        assert hello["src"] == "fake:show" and hello["fake"] is True
        assert len(hello["abilities"]["fault"]["faults"]) >= 10
        assert {step["name"] for step in hello["abilities"]["calibrate"]["steps"]} >= {"rest", "faces", "check"}

        assert await visitor.ask("fault", "inject", name="disturbed") == (
            True,
            "Disturb the next twelve transfers on the wires: done",
        )
        one = await visitor.until(lambda new: new["fault"]["history"] and new["fault"]["history"][-1])
        assert one["title"] == "Disturb the next twelve transfers on the wires"
        over = await visitor.until(lambda new: (one := new["fault"]["history"][-1])["over"] and one)
        assert over["noticed_ms"] is not None and "bus_errors" in over["how"]
        assert over["before_deg"] is not None

        assert (await visitor.ask("fault", "inject", name="nothing"))[0] is False
        ok, said = await visitor.ask("calibrate", "start")
        assert ok and "nothing is kept" in said
        state = await visitor.until(lambda new: (now := new["calibrate"])["running"] and now["q"] and now)
        assert state["view"]["instruction"].startswith("Leave the board lying still")

    visit(demo, look)
    # The session would take a minute more.
    assert demo.end() < 20.0
    assert demo.program.returncode == 0
    assert not any(noise in line for noise in NOISE for line in demo.said)
    assert any("this is a fake chip (fake:show)" in line and "run --web --bus linux:1" in line for line in demo.said)


def test_without_a_page_there_is_a_port_or_another_board() -> None:
    assert quavelet("demo", "--port", 8050).code == 2
    done = quavelet("demo", "--virtual-time", "--duration", 1)
    assert "(fake:tilt)" in done.said[0] and "--web" not in done.said[0]


def test_the_demo_without_a_page_pays_for_one() -> None:
    ask = "import sys, quavelet.cli.demo; print('aiohttp' in sys.modules)"
    told = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True).stdout
    assert told.strip() == "False"
