"""The page in a service: off it costs nothing, on it shows the chip, says where it is, and outlives a reload."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import threading
from dataclasses import dataclass

import aiohttp
import msgspec
import pytest
import typer
from waiting import eventually
from web_rig import Noting, Watching

from quavelet.cli import options
from quavelet.core.clock import MonotonicClock, VirtualClock
from quavelet.core.errors import SettingsError
from quavelet.service.drop_ins import NETWORK, needed
from quavelet.service.service import Service
from quavelet.settings import BusSettings, OutputSettings, Settings, WebSettings, parse_settings

PAGE = WebSettings(listen="127.0.0.1:0")


@dataclass
class Running:
    """A service on the fake that runs in real time on a thread of its own."""

    service: Service
    said: list[str]

    @property
    def port(self) -> int:
        assert self.service.outputs.page is not None
        return self.service.outputs.page.port

    def watch(self, until: str, **fields: object) -> list[dict[str, object]]:
        """All frames up to one of that kind with those fields."""

        async def look() -> list[dict[str, object]]:
            url = f"http://127.0.0.1:{self.port}"
            async with aiohttp.ClientSession() as session, session.ws_connect(f"{url}/live", origin=url) as live:
                viewer = Watching(live)
                await viewer.until(until, **fields)
                return viewer.got

        return asyncio.run(look())


@pytest.fixture
def running():
    ends = []

    def start(settings: Settings, **more: object) -> Running:
        said: list[str] = []
        service = Service(settings, clock=MonotonicClock(), talk=said.append, realtime=False, environ={}, **more)
        thread = threading.Thread(target=service.run)
        thread.start()
        ends.append((service, thread))
        assert eventually(lambda: any("the page is at" in text for text in said))
        return Running(service, said)

    yield start
    for service, thread in ends:
        service.stop()
        thread.join(20)
        assert not thread.is_alive()


def test_a_service_without_a_page_never_imports_aiohttp_and_begins_no_thread():
    code = (
        "import sys, threading\n"
        "from quavelet.cli.app import main\n"
        "sys.argv = ['quavelet', 'demo', '--virtual-time', '--duration', '0.5', '--json']\n"
        "try:\n"
        "    main()\n"
        "except SystemExit as end:\n"
        "    assert not end.code, end.code\n"
        "assert 'aiohttp' not in sys.modules and 'quavelet.web.server' not in sys.modules\n"
        "assert 'network' not in {thread.name for thread in threading.enumerate()}\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr


def test_the_page_shows_the_chip_its_flags_the_loops_lateness_and_what_the_program_says(running):
    there = running(Settings(bus=BusSettings(name="fake:tilt"), web=PAGE))
    frames = there.watch("message")
    hello = frames[0]
    assert (hello["is"], hello["src"], hello["fake"], hello["name"]) == ("hello", "fake:tilt", True, "imu")
    message = frames[-1]
    assert message["m"]["src"] == "fake:tilt" and 0 <= message["now_ns"] - message["m"]["t_ns"] < 2_000_000_000
    status = next(frame for frame in there.watch("status") if frame["is"] == "status")
    assert sum(status["lateness"]["counts"]) > 0
    there.service.talk("a sentence")
    assert there.watch("talk", text="a sentence")


def test_a_reload_keeps_the_page_and_its_viewers(running):
    before = Settings(bus=BusSettings(name="fake:tilt"), web=PAGE)
    after = msgspec.structs.replace(before, output={"a": OutputSettings(to="udp:127.0.0.1:9", rate_hz=1.0)})
    there = running(before, load=lambda: after)
    page, port = there.service.outputs.page, there.port
    there.service.reload()
    assert eventually(lambda: any("the settings were read again" in text for text in there.said))
    assert there.service.outputs.page is page and there.port == port
    assert there.watch("message")
    assert sum("the page is at" in text for text in there.said) == 1


def test_a_port_that_is_taken_is_told_and_the_rest_goes_on(running):
    there = running(Settings(bus=BusSettings(name="fake:tilt"), web=PAGE))
    said: list[str] = []
    again = WebSettings(listen=f"127.0.0.1:{there.port}")
    second = Service(
        Settings(bus=BusSettings(name="fake:tilt"), web=again), clock=MonotonicClock(), talk=said.append, realtime=False
    )
    thread = threading.Thread(target=second.run)
    thread.start()
    try:
        assert eventually(lambda: any(text.startswith("page: ") for text in said))
        assert eventually(lambda: second.last is not None)
    finally:
        second.stop()
        thread.join(20)


def test_abilities_see_every_message_and_are_closed_once_at_the_end():
    noting = Noting()
    service = Service(
        Settings(bus=BusSettings(name="fake:tilt"), web=PAGE),
        clock=VirtualClock(),
        talk=lambda _: None,
        realtime=False,
        environ={},
        abilities=(noting,),
    )
    service.run(until_ns=3_000_000_000)
    assert noting.seen > 200 and noting.closed == 1


def test_without_aiohttp_the_start_says_what_to_install(monkeypatch):
    monkeypatch.setattr("quavelet.web.page.find_spec", lambda _: None)
    with pytest.raises(SettingsError, match=r"pip install 'quavelet\[web\]'"):
        Service(Settings(bus=BusSettings(name="fake:tilt"), web=PAGE), clock=VirtualClock(), talk=print, realtime=False)
    Service(Settings(bus=BusSettings(name="fake:tilt")), clock=VirtualClock(), talk=print, realtime=False)


@pytest.mark.parametrize(
    ("toml", "web", "port", "listen"),
    [
        ("", True, None, "127.0.0.1:8050"),
        ("", True, 9000, "127.0.0.1:9000"),
        ("", False, None, ""),
        ('[web]\nlisten = "0.0.0.0:8051"\n', False, None, "0.0.0.0:8051"),
        ('[web]\nlisten = "0.0.0.0:8051"\n', True, None, "0.0.0.0:8051"),
        ('[web]\nlisten = "[::]:8051"\n', False, 0, "[::]:0"),
    ],
)
def test_where_the_page_is_by_options_and_settings(tmp_path, toml, web, port, listen):
    file = tmp_path / "imu.toml"
    file.write_text(toml)
    assert options.settings_of(None, None, file, web=web, port=port).settings.web.listen == listen


def test_a_port_without_a_page_is_a_mistake():
    with pytest.raises(typer.BadParameter, match="--web"):
        options.settings_of(None, None, None, port=8050)


@pytest.mark.parametrize(
    "table",
    [
        {"listen": "nowhere"},
        {"listen": "a:99999"},
        {"viewers": 0},
        {"viewers": 33},
        {"rate_hz": 0.5},
        {"rate_hz": 1000.0},
        {"token_file": "a\0b"},
        {"recordings": "a\0b"},
        {"port": 1},
    ],
)
def test_settings_of_the_page_that_cannot_be_are_told_by_their_key(table):
    with pytest.raises(SettingsError, match=next(iter(table))):
        parse_settings({"web": table}, where="x.toml")


def test_a_page_needs_the_network_in_the_unit():
    assert NETWORK in needed(Settings(web=PAGE))
    assert NETWORK not in needed(Settings())
