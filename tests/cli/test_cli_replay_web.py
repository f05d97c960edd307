"""`quavelet replay --web`: the page of a recording, from its start to Ctrl-C."""

import asyncio
import json
import re
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import aiohttp
import pytest
from program import PROGRAM, quavelet

PATIENCE_S = 40


@contextmanager
def playing(*arguments: object) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The program, and what it said up to where its page is."""
    program = subprocess.Popen(
        [PROGRAM, "replay", "--web", "--port", "0", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert program.stderr is not None
        said = ""
        while "http://" not in said:
            line = program.stderr.readline()
            assert line, said
            said += line
        yield program, said
    finally:
        program.kill()
        program.communicate()


async def asked(url: str) -> dict[str, object]:
    """What a viewer sees who goes to 3 s, pauses there, and asks for nonsense."""
    seen: dict[str, object] = {}
    async with aiohttp.ClientSession() as session, asyncio.timeout(PATIENCE_S):
        async with session.get(url) as page:
            seen["page"] = page.status, await page.text()
        async with session.ws_connect(f"{url}/live", headers={"Origin": url}) as live:
            newest: dict[str, dict[str, object]] = {}

            async def until(kind: str) -> dict[str, object]:
                while True:
                    frame = json.loads((await live.receive()).data)
                    newest[frame["is"]] = frame
                    if frame["is"] == kind:
                        return frame

            async def do(what: str, **values: object) -> dict[str, object]:
                await live.send_json({"n": 1, "ability": "play", "what": what, "values": values})
                return await until("answer")

            seen["hello"] = await until("hello")
            await until("history")
            seen["message"] = (await until("message"))["m"]
            seen["paused"] = await do("pause")
            seen["refused"] = await do("seek", t_s="soon")
            await live.send_json({"n": 2, "ability": "play", "what": "seek", "values": {"t_s": 3.0}})
            seen["history"] = await until("history")
            # It may say that it is there before or after it shows it.
            while newest["ability"]["state"]["t_s"] != 3.0:
                await until("ability")
            seen["state"] = newest["ability"]["state"]
            seen["status"] = (await until("status"))["s"]
    return seen


def test_a_recording_is_played_on_the_page_sought_in_and_stopped_by_ctrl_c(recording: Path) -> None:
    with playing(recording) as (program, said):
        where = re.search(r"http://[^/]+", said)
        assert where
        seen = asyncio.run(asked(where[0]))
        program.send_signal(signal.SIGINT)
        out, err = program.communicate(timeout=PATIENCE_S)
    assert program.returncode == 0, err
    assert out == ""
    assert "samples from fake:tilt" in err
    status, text = seen["page"]
    assert status == 200
    assert "<html" in text
    hello = seen["hello"]
    assert (hello["src"], hello["fake"]) == ("replay:fake:tilt", True)
    assert hello["abilities"]["play"]["length_s"] == pytest.approx(5.0, abs=0.3)
    live = {
        message["t_ns"]: message
        for message in map(json.loads, recording.with_suffix(".jsonl").read_text().splitlines())
    }
    assert seen["message"]["t_ns"] >= min(live)
    assert seen["paused"]["ok"]
    assert not seen["refused"]["ok"]
    times = seen["history"]["t_ns"]
    assert 20 <= len(times) <= 32
    assert set(times) <= set(live)
    assert seen["state"]["paused"]
    assert seen["status"]["message"]["q"] == live[seen["status"]["message"]["t_ns"]]["q"]
    assert seen["status"]["state"] == "running"
    assert 500 < seen["status"]["health"]["samples"] < 700


def test_a_cut_recording_says_so_and_is_played_all_the_same(recording: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.qrec"
    cut.write_bytes(recording.read_bytes()[:-2000])
    with playing(cut) as (program, said):
        assert program.stderr is not None
        # Which comes first is a matter of how fast the file is gone through.
        said += "" if "cut off" in said else program.stderr.readline()
        program.send_signal(signal.SIGTERM)
        program.communicate(timeout=PATIENCE_S)
    assert "cut off, or never closed" in said
    assert program.returncode == 0


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["--port", 8051], 2, "give --web too"),
        (["--web", "--mcap", "out.mcap"], 2, "leave --web out"),
        (["--web", "--speed", "1000"], 2, "give one from 0.1 to 100"),
    ],
)
def test_what_does_not_go_together_is_a_usage_error(
    recording: Path, arguments: list[object], code: int, words: str
) -> None:
    done = quavelet("replay", recording, *arguments)
    assert done.code == code
    assert words in re.sub(r"[\s│]+", " ", done.err)


def test_an_empty_file_is_refused_before_there_is_a_page(tmp_path: Path) -> None:
    (tmp_path / "a.qrec").touch()
    done = quavelet("replay", tmp_path / "a.qrec", "--web", "--port", 0)
    assert done.code == 1
    assert "is empty" in done.err
