"""What the browser complains of: nothing, in whatever state the page is; every other test of this room holds it too."""

from __future__ import annotations

import re

import pytest
from browser_seen import Seen
from live_service import Program


@pytest.mark.slow
def test_a_complaint_of_any_kind_is_seen(chromium, service):
    seen = Seen(chromium, service.url)
    page = seen.is_live()
    page.evaluate("console.warn('so so')")
    page.evaluate("setTimeout(() => { throw new Error('a mistake') })")
    page.evaluate("fetch('http://127.0.0.2:9/').catch(() => 0)")
    page.evaluate("document.body.setAttribute('style', 'color: red')")
    page.wait_for_timeout(300)
    said = "\n".join(seen.close())
    assert "warning: so so" in said
    assert "mistake: a mistake" in said
    assert "127.0.0.2:9" in said
    assert re.search(r"(?i)refused to apply inline style|violates.*style-src", said), said


@pytest.mark.parametrize("webgl", [True, pytest.param(False, marks=pytest.mark.slow)], ids=["webgl", "without webgl"])
def test_a_demo_is_looked_at_without_a_complaint(webgl, request, look, tmp_path):
    browser = request.getfixturevalue("chromium" if webgl else "chromium_without_webgl")
    with Program("demo", "--json", "--web", "--port", 0, cwd=tmp_path) as demo:
        seen = look(demo.url, browser=browser)
        page = seen.is_live()
        page.wait_for_selector(f"#board[data-kind={'webgl' if webgl else 'plain'}]")
        assert page.inner_text("#fake").lower().startswith("not a real chip")
        for span in page.query_selector_all("#spans label"):
            span.click()
        page.click("#theme")
        page.click("summary")
        page.set_viewport_size({"width": 390, "height": 844})
        page.wait_for_timeout(1500)
        assert seen.complaints == []
        # Before the program ends: the browser itself says so in the console.
        page.goto("about:blank")


def test_the_words_without_javascript_say_what_to_do(look, service):
    page = look(service.url, java_script_enabled=False).page
    assert "JavaScript" in page.inner_text("noscript")
