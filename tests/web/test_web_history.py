"""The last ten minutes: rows at their times, gaps kept, and no past where time has jumped."""

from __future__ import annotations

from itertools import pairwise

import msgspec
import pytest
from output_plans import MESSAGE
from web_rig import Noting, Rig, run

from quavelet.core.units import NS_PER_MS
from quavelet.loop.histogram import Histogram
from quavelet.sinks.message import Message
from quavelet.web.frames import lateness_of
from quavelet.web.history import CHUNK, COLUMNS, ROWS, History


def at(t_ms: float, **fields: object) -> Message:
    return msgspec.structs.replace(MESSAGE, t_ns=round(t_ms * NS_PER_MS), **fields)


def rows(history: History) -> dict[str, list[float]]:
    frame = history.frame()
    whole = msgspec.json.decode(frame[frame.index(b"{") :])
    assert whole.pop("is") == "history"
    assert list(whole) == list(COLUMNS) and len({len(column) for column in whole.values()}) == 1
    return whole


def test_a_row_is_what_the_message_was_in_degrees():
    history = History()
    history.add(at(1.0, gyro_rad_s=(0.1, -0.2, 3.14159265), sigma_deg=(0.1, 0.2, 3.4567), gap_ns=3, temp_degc=31.256))
    assert rows(history) == {
        "t_ns": [1_000_000],
        "roll_deg": [1.5],
        "pitch_deg": [-2.25],
        "yaw_deg": [30.0],
        "sigma_yaw_deg": [3.457],
        "gyro_x_dps": [5.73],
        "gyro_y_dps": [-11.46],
        "gyro_z_dps": [180.0],
        "temp_degc": [31.26],
        "gap_ns": [3],
    }


@pytest.mark.parametrize("every_ms", [1.0, 5.0, 10.0, 33.3])
def test_ten_rows_a_second_and_the_gaps_of_what_is_left_out(every_ms):
    history = History()
    n = round(60_000 / every_ms)
    for i in range(n):
        history.add(at(1000 + i * every_ms, gap_ns=1))
    found = rows(history)
    assert 590 <= len(found["t_ns"]) <= 610
    assert found["t_ns"] == sorted(found["t_ns"])
    # What is left out behind the last row is not there yet.
    assert n - 100 / every_ms - 1 <= sum(found["gap_ns"]) <= n


def test_no_more_than_ten_minutes_and_a_chunk_are_kept():
    history = History()
    for i in range(ROWS + 3 * CHUNK + 7):
        history.add(at(100.0 * i))
    found = rows(history)["t_ns"]
    assert ROWS <= len(found) < ROWS + CHUNK and found[-1] == (ROWS + 3 * CHUNK + 6) * 100 * NS_PER_MS
    assert [b - a for a, b in pairwise(found)] == [100 * NS_PER_MS] * (len(found) - 1)


def test_what_is_no_number_is_null_and_not_broken_json():
    history = History()
    history.add(at(1.0, roll_deg=float("nan"), temp_degc=float("inf")))
    assert (rows(history)["roll_deg"], rows(history)["temp_degc"]) == ([None], [None])


class Past(Noting):
    """A player that knows what was before."""

    def __init__(self) -> None:
        super().__init__()
        self.next_ns: int | None = None

    def past(self, message: Message) -> list[Message] | None:
        expected_ns, self.next_ns = self.next_ns, message.t_ns + 10 * NS_PER_MS
        if expected_ns in (None, message.t_ns):
            return None
        return [at(t_ms) for t_ms in range(0, 1000, 100)]


@pytest.mark.parametrize("jump_ms", [-20_000, 60_000, 500])
def test_after_a_jump_in_time_the_past_is_that_of_the_new_place(jump_ms):
    async def scenario(rig: Rig) -> None:
        rig.t_ms = 30_000
        for _ in range(100):
            rig.message()
        async with rig.viewer() as viewer:
            assert len((await viewer.until("history"))["t_ns"]) == 10
            await viewer.until("message")
            rig.t_ms += jump_ms
            there = rig.message()
            assert (await viewer.until("history"))["t_ns"] == [t_ms * NS_PER_MS for t_ms in range(0, 1000, 100)]
            assert (await viewer.until("message"))["m"]["t_ns"] == there.t_ns

    run(scenario, abilities=(Past(),))


def test_a_long_gap_is_no_jump():
    async def scenario(rig: Rig) -> None:
        rig.message()
        rig.t_ms += 60_000
        rig.message(gap_ns=60_000 * NS_PER_MS)
        async with rig.viewer() as viewer:
            assert (await viewer.until("history"))["gap_ns"] == [0, 60_000 * NS_PER_MS]

    run(scenario)


def test_bars_of_lateness_have_an_edge_more_than_bars_and_lose_nothing():
    histogram = Histogram()
    assert lateness_of(histogram) == {"edges_us": [], "counts": []}
    for ns in (500, 1_000, 1_500, 20_000, 999_999, 30_000_000_000):
        histogram.add(ns)
    bars = lateness_of(histogram)
    edges, counts = bars["edges_us"], bars["counts"]
    assert sum(counts) == 6 and len(edges) == len(counts) + 1
    assert (edges[0], edges[-1], counts[0], counts[-1]) == (1.0, 1e7, 3, 1)
    assert counts[next(i for i, edge in enumerate(edges) if edge > 20.0) - 1] == 1
