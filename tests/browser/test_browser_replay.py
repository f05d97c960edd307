"""A recording on the page: played, paused, sought, at any speed, by the keyboard too; what is drawn is the truth."""

from __future__ import annotations

import numpy as np
import pytest
from browser_memory import heap_mb, process_mb
from live_service import START_NS, Program, live_motion, record
from looked_over import low_contrasts, nameless, scrolls_sideways, small_targets, tabbed, unreached

from quavelet.core.quaternion import angle_between, inclination_between

LENGTH_S = 45
SOON_MS = 60_000
KNOWN_MS = 900_000
# To draw all of a canvas anew begins with its width.
COUNT_OVERVIEWS = """() => {
  window.overviews = 0;
  new MutationObserver((changes) => (window.overviews += changes.length))
    .observe(document.querySelector("#replay canvas"), { attributes: true, attributeFilter: ["width"] });
}"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("replay") / "lively.qvl"
    return path, record(path, live_motion(), length_s=LENGTH_S)


@pytest.fixture(scope="module")
def player(recorded):
    with Program("replay", recorded[0], "--web", "--port", 0, cwd=recorded[0].parent) as program:
        yield program


def t_s(page):
    return float(page.input_value("#replay input"))


def drawn_until(seen, is_there, *, within_ms=SOON_MS):
    """Wait for a frame of a sample at such a time."""
    for _ in range(within_ms // 200):
        seen.page.wait_for_timeout(200)
        if is_there(int(seen.page.get_attribute("#board", "data-t-ns"))):
            return
    raise AssertionError("it was not drawn")


def test_what_is_played_sought_and_played_again_is_drawn_as_it_was(recorded, player, look):
    seen = look(player.url)
    page = seen.is_live()
    page.wait_for_selector("#replay:not([hidden])")
    seen.record()
    page.wait_for_timeout(1500)
    for sought_s in 35.5, 12:
        page.fill("#replay input", str(sought_s))
        first_ns = START_NS + round(sought_s * 1e9)
        drawn_until(seen, lambda t_ns, first_ns=first_ns: first_ns < t_ns < first_ns + 2e9)
    page.wait_for_timeout(1000)
    drawn = seen.drawn()
    bus = recorded[1]
    since_s = (drawn.t_ns - drawn.t_ns.min()) / 1e9
    settled = drawn.t_ns > START_NS + 4e9
    off_deg = np.degrees(angle_between(bus.attitude(drawn.t_ns), drawn.q))[settled]
    print(f"\n{len(off_deg)} frames of {since_s.max():.0f} s of a recording, off by {off_deg.max():.2f} deg at most")
    assert since_s.max() > 20
    assert (np.diff(drawn.t_ns) < 0).any()
    assert off_deg.max() < 1
    assert page.is_hidden("#veil")


@pytest.mark.slow
def test_pause_step_and_speed_by_the_keyboard(player, look):
    page = look(player.url).is_live()
    page.wait_for_selector("#replay:not([hidden])")
    page.focus("#main")
    page.keyboard.press("Home")
    page.keyboard.press("Space")
    page.wait_for_selector("body.paused", timeout=SOON_MS)
    page.wait_for_timeout(500)
    at_s = t_s(page)
    page.wait_for_timeout(800)
    assert t_s(page) == at_s
    # What stands still because it is paused is not stale.
    assert page.is_hidden("#veil")
    page.keyboard.press("ArrowRight")
    page.wait_for_timeout(1500)
    assert t_s(page) == pytest.approx(at_s + 5, abs=0.3)
    assert "paused" in page.inner_text("#replay .time")
    page.select_option("#replay select", "8")
    page.focus("#main")
    page.keyboard.press("Space")
    page.wait_for_selector("body:not(.paused)")
    before_s = t_s(page)
    page.wait_for_timeout(3000)
    fast_s = t_s(page) - before_s
    page.select_option("#replay select", "1")
    print(f"\nat 8 x: {fast_s:.1f} s in 3 s")
    assert fast_s > 8
    page.fill("#replay input", str(LENGTH_S - 1))
    page.wait_for_selector("#replay .time:has-text('ended')", timeout=SOON_MS)
    page.get_by_role("button", name="Play again").click()
    page.wait_for_selector("#replay .time:not(:has-text('ended'))", timeout=SOON_MS)
    assert t_s(page) < 20


@pytest.mark.slow
def test_the_player_is_there_for_all(player, look):
    page = look(player.url).is_live()
    page.wait_for_selector("#replay:not([hidden])")
    stops = tabbed(page)
    assert unreached(page) == []
    assert [stop for stop in stops if not stop["drawn"]] == []
    assert nameless(page) == []
    assert low_contrasts(page) == []
    for width in 320, 390, 1280:
        page.set_viewport_size({"width": width, "height": 800})
        page.wait_for_timeout(200)
        assert (width, scrolls_sideways(page)) == (width, [])
        assert (width, small_targets(page)) == (width, [])


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_an_hour_loads_seeks_and_plays_below_200_mb(tmp_path, chromium, look):
    bus = record(tmp_path / "hour.qvl", live_motion(), length_s=3600)
    with Program("replay", tmp_path / "hour.qvl", "--web", "--port", 0, cwd=tmp_path) as program:
        seen = look(program.url)
        page = seen.is_live()
        page.wait_for_selector("#replay:not([hidden])")
        seen.record()
        page.evaluate(COUNT_OVERVIEWS)
        page.wait_for_timeout(10_000)
        overviews = page.evaluate("window.overviews")
        # The first is waited for until the recording has been gone through so far.
        for sought_s, within_ms in (3500, KNOWN_MS), (10, SOON_MS), (1800, SOON_MS), (2700, SOON_MS), (3000, SOON_MS):
            page.fill("#replay input", str(sought_s))
            first_ns = START_NS + round(sought_s * 1e9)
            drawn_until(seen, lambda t_ns, first=first_ns: first < t_ns < first + 20e9, within_ms=within_ms)
        drawn = seen.drawn()
        off_deg = np.degrees(inclination_between(bus.attitude(drawn.t_ns), drawn.q))[drawn.t_ns > START_NS + 4e9]
        heap, whole = heap_mb(page), process_mb(chromium, page)
        print(
            f"\nan hour: {(drawn.t_ns.max() - drawn.t_ns.min()) / 1e9:.0f} s apart, tilt {off_deg.max():.2f} deg off; "
            f"heap {heap:.1f} MB, the page's process {whole:.0f} MB; {overviews} overviews drawn in 10 s"
        )
        # It grows all the time, and is sent anew every two seconds.
        assert 1 <= overviews <= 8
        assert off_deg.max() < 1
        assert heap < 200
        assert whole < 200
        page.goto("about:blank")
