"""The page in a real Chromium without a screen, driven by Playwright: `pytest tests/browser`, `-s` for the figures.

`apt install chromium` is all it needs; where there is no Chromium the tests skip. The longer forms: `-m slow`.
The pictures that are looked at by eye: `python tests/browser/screenshots.py DIRECTORY`.

A page that is opened by `look` is asked at the end of its test what its browser complained of: a line in the console,
a mistake in a script, what the Content-Security-Policy refused, a request to any other place. There is none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from browser_seen import Seen, chromium_path, launch
from live_service import LiveService, live_motion
from playwright.sync_api import Browser, Playwright, sync_playwright


@pytest.fixture(scope="module")
def playwright() -> Iterator[Playwright]:
    """Of one file: while it is open asyncio.run is refused in this thread, and other rooms use that."""
    if chromium_path() is None:
        pytest.skip("there is no Chromium on this machine: apt install chromium")
    with sync_playwright() as playwright:
        yield playwright


@pytest.fixture(scope="module")
def chromium(playwright: Playwright) -> Iterator[Browser]:
    """With WebGL, by software."""
    browser = launch(playwright, webgl=True)
    yield browser
    browser.close()


@pytest.fixture(scope="module")
def chromium_without_webgl(playwright: Playwright) -> Iterator[Browser]:
    browser = launch(playwright, webgl=False)
    yield browser
    browser.close()


@pytest.fixture(scope="module")
def service() -> Iterator[LiveService]:
    """Of one file: a board in lively motion, and its page."""
    with LiveService(live_motion()) as service:
        yield service


@pytest.fixture
def look(chromium: Browser) -> Iterator[Callable[..., Seen]]:
    """Opens a page in a context of its own, closed at the end; what it complained of fails the test."""
    opened: list[Seen] = []

    def look(url: str, *, browser: Browser | None = None, **context: Any) -> Seen:
        opened.append(Seen(browser or chromium, url, **context))
        return opened[-1]

    yield look
    complaints = [seen.close() for seen in opened]
    assert complaints == [[] for _ in opened]
