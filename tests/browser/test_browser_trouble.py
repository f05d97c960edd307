"""A chip that is lost, a gap, a server that dies: said in words, never as if all were well, and over by itself."""

from __future__ import annotations

import re
import socket
import time

import pytest
from browser_seen import REFUSED
from live_service import LiveService, Program, live_motion

SOON_S = 60
"""How long a busy machine is waited for; what it took is printed."""


@pytest.fixture
def breakable():
    with LiveService(live_motion()) as service:
        yield service


def after(page, selector, since_s):
    """Seconds from then to when there was such an element."""
    page.wait_for_selector(selector, timeout=1000 * SOON_S, state="attached")
    return time.monotonic() - since_s


def test_a_lost_chip_greys_what_is_shown_says_what_to_do_and_all_comes_back(breakable, look):
    page = look(breakable.url).is_live()
    assert page.is_hidden("#veil")
    began_s = time.monotonic()
    breakable.bus.fail("unplugged for=6")
    stale_s = after(page, "body.stale", began_s)
    assert page.is_visible("#veil")
    words_s = after(page, "#words li[data-level=bad] .do", began_s)
    told_s = after(page, "#assertive:not(:empty)", began_s)
    assert "no data" in page.inner_text("#veil").lower()
    assert page.inner_text("#link-text") == "no data"
    assert "wires" in page.inner_text("#words")
    greyed = page.evaluate("getComputedStyle(document.querySelector('#board-scene')).filter")
    assert "grayscale(1)" in greyed
    said = page.text_content("#assertive").lower()
    assert "no data" in said or "lost" in said
    drawn = page.get_attribute("#board", "data-drawn")
    page.wait_for_selector("body:not(.stale)", timeout=1000 * SOON_S)
    back_s = time.monotonic() - began_s
    page.wait_for_selector(f"#board:not([data-drawn='{drawn}'])", timeout=1000 * SOON_S)
    assert page.is_hidden("#veil")
    page.wait_for_selector("#polite:not(:empty)", state="attached")
    print(
        f"\nunplugged for 6 s: greyed after {stale_s:.1f} s, said what to do after {words_s:.1f} s, "
        f"announced after {told_s:.1f} s, live again after {back_s:.1f} s"
    )


@pytest.mark.slow
def test_a_gap_is_a_break_in_the_strips_a_flag_and_a_sentence(breakable, look):
    page = look(breakable.url).is_live()
    page.wait_for_selector("#words li[data-level=good]", timeout=1000 * SOON_S)
    breakable.bus.fail("unplugged for=0.7")
    page.wait_for_selector("#words li[data-level=warn]:has-text('Samples are missing')", timeout=1000 * SOON_S)
    page.wait_for_selector("#strip-angles .plot[aria-label*='gap']", timeout=1000 * SOON_S)
    facts = page.inner_text("#facts")
    assert "1 gap" in facts or "gaps" in facts


@pytest.mark.slow
def test_a_fault_is_injected_from_the_page_by_the_keyboard_and_what_became_of_it_is_told(breakable, look):
    page = look(breakable.url).is_live()
    page.wait_for_selector(".fault-button")
    page.focus(".fault-button >> nth=0")
    page.keyboard.press("Enter")
    page.wait_for_selector(".fault-history li[data-level=good]", timeout=1000 * SOON_S)
    told = page.inner_text(".fault-history li >> nth=0")
    print("\n" + told.replace("\n", "; "))
    assert "noticed after" in told.lower()


@pytest.mark.slow
def test_a_page_that_was_held_up_does_not_take_its_connection_for_lost(breakable, look):
    """Nor is what it asked for just then forgotten with it."""
    seen = look(breakable.url)
    page = seen.is_live()
    page.wait_for_timeout(3000)
    opened = []
    page.on("websocket", lambda socket: opened.append(socket.url))
    page.evaluate("() => { for (const end = performance.now() + 7000; performance.now() < end; ); }")
    page.get_by_role("button", name="Yaw counts from here").click()
    page.wait_for_selector(".toast[data-level=good]", timeout=1000 * SOON_S)
    page.wait_for_timeout(2000)
    assert opened == []


@pytest.fixture
def port():
    with socket.socket() as free:
        free.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


@pytest.mark.slow
def test_a_server_that_dies_is_told_and_one_that_comes_back_is_found_without_a_reload(port, look, tmp_path):
    program = Program("demo", "--json", "--web", "--port", port, cwd=tmp_path)
    with program:
        page = look(program.url, allowed=REFUSED).is_live()
        page.evaluate("window.never = 'loaded again'")
        program.kill()
        killed_s = time.monotonic()
        lost_s = after(page, "body.stale", killed_s)
        assert "connection" in page.inner_text("#link-text")
        assert "connection" in page.inner_text("#veil").lower()
        # As long as a machine takes to start again: the page asks less often by then, but no less than each 5 s.
        waits_s = set()
        for _ in range(50):
            page.wait_for_timeout(200)
            waits_s |= {int(n) for n in re.findall(r"again in (\d+) s", page.inner_text("#veil"))}
    with Program("demo", "--json", "--web", "--port", port, cwd=tmp_path) as again:
        there_s = time.monotonic()
        page.wait_for_selector("body:not(.stale)", timeout=1000 * SOON_S)
        back_s = time.monotonic() - there_s
        assert page.inner_text("#link-text") == "live"
        assert page.evaluate("window.never") == "loaded again"
        assert page.is_hidden("#veil")
        page.wait_for_selector("#strip-angles .plot[aria-label*='roll']")
        assert again.port == port
        print(f"\nserver killed: told after {lost_s:.1f} s; live {back_s:.1f} s after another one listened")
        page.goto("about:blank")
    assert 1 < max(waits_s) <= 5
