"""By keyboard, by screen reader, on a small screen, in both colours: everything is there, and can be read."""

from __future__ import annotations

import pytest
from live_service import LiveService, live_motion
from looked_over import low_contrasts, nameless, scrolls_sideways, small_targets, tabbed, unreached


@pytest.fixture(scope="module")
def breakable():
    with LiveService(live_motion()) as service:
        yield service


@pytest.mark.slow
def test_every_control_is_reached_by_tab_and_shows_that_it_has_the_focus(breakable, look):
    page = look(breakable.url).is_live()
    page.wait_for_selector(".fault-button")
    page.evaluate("document.querySelector('details').open = true")
    stops = tabbed(page)
    print(f"\n{len(stops)} stops")
    assert unreached(page) == []
    assert [stop for stop in stops if not stop["drawn"]] == []
    assert [stop for stop in stops if not stop["inView"]] == []


def test_buttons_radios_and_details_do_what_they_do_by_the_keyboard(breakable, look):
    page = look(breakable.url).is_live()
    page.focus("#theme")
    named = page.get_attribute("#theme", "aria-label")
    page.keyboard.press("Space")
    assert page.get_attribute("#theme", "aria-label") != named
    page.keyboard.press("Enter")
    page.focus("#spans input:checked")
    was = page.eval_on_selector("#spans input:checked", "(one) => one.value")
    page.keyboard.press("ArrowRight")
    assert page.eval_on_selector("#spans input:checked", "(one) => one.value") != was
    page.focus("summary")
    page.keyboard.press("Enter")
    assert page.is_visible("#counters")
    page.keyboard.press("Space")
    assert page.is_hidden("#counters")
    page.focus(".skip")
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "main"


@pytest.mark.parametrize("colours", ["light", pytest.param("dark", marks=pytest.mark.slow)])
def test_all_text_can_be_read_and_everything_has_a_name(colours, breakable, look):
    page = look(breakable.url, color_scheme=colours).is_live()
    page.wait_for_selector(".fault-button")
    page.click("summary")
    assert low_contrasts(page) == []
    assert nameless(page) == []
    # The same in trouble: a veil over the board, sentences of what is wrong.
    breakable.bus.fail("unplugged for=5")
    page.wait_for_selector(".stale #words li[data-level=bad]", timeout=30_000)
    in_trouble = low_contrasts(page)
    page.wait_for_selector("body:not(.stale)", timeout=60_000)
    assert in_trouble == []


def test_no_width_scrolls_sideways_or_has_targets_that_a_finger_misses(breakable, look):
    page = look(breakable.url).is_live()
    page.wait_for_selector(".fault-button")
    for width in 320, 390, 768, 1280:
        page.set_viewport_size({"width": width, "height": 800})
        page.wait_for_timeout(200)
        assert (width, scrolls_sideways(page)) == (width, [])
        assert (width, small_targets(page)) == (width, [])


@pytest.mark.slow
def test_the_board_is_told_in_words_once_a_second(breakable, look):
    page = look(breakable.url).is_live()
    page.wait_for_selector("#board-text:has-text('X ')")
    assert page.get_attribute("#board", "aria-describedby") == "board-text"
    live = page.eval_on_selector_all("[aria-live]", "(all) => all.map((one) => one.getAttribute('aria-live'))")
    assert {"polite", "assertive"} <= set(live)
    # A reader is not to be talked to at each of thirty messages a second.
    page.evaluate("""() => {
      window.said = 0;
      const count = new MutationObserver((changes) => (window.said += changes.length));
      for (const one of document.querySelectorAll("[aria-live], [role=status], [role=alert]"))
        count.observe(one, { childList: true, subtree: true, characterData: true });
    }""")
    page.wait_for_timeout(3000)
    assert page.evaluate("window.said") <= 3
