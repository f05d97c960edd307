"""Pictures of the page in all its states, to be looked at by eye: `python tests/browser/screenshots.py DIRECTORY`.

Each state on a telephone and on a desk, light and dark: live-phone-dark.png, ...
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from browser_seen import chromium_path, launch
from live_service import LiveService, Program, record
from playwright.sync_api import Browser, Page, sync_playwright

from hw_fakes import Show

SIZES = {"phone": (390, 844), "desktop": (1280, 800)}
COLOURS = "light", "dark"
SOON_MS = 60_000


def main(folder: Path) -> None:
    if chromium_path() is None:
        raise SystemExit("there is no Chromium on this machine: apt install chromium")
    folder.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as temporary:
        there = Path(temporary)
        with_webgl, without = launch(playwright, webgl=True), launch(playwright, webgl=False)
        with LiveService(Show(), recordings=str(there)) as service:
            _live(folder, service, with_webgl, without)
        with LiveService(Show(), listen="0.0.0.0:0", token_file="") as service:
            url = f"http://127.0.0.1:{service.service.outputs.page.port}/"
            with _pages(with_webgl, url) as pages:
                _take(folder, "login", pages, before=_wrong_token)
        recording = there / "a-minute.qrec"
        record(recording, Show(), length_s=60, fault="unplugged at=40 for=1.5")
        with (
            Program("replay", recording, "--web", "--port", 0, cwd=there) as program,
            _pages(with_webgl, program.url) as pages,
        ):
            next(iter(pages.values())).fill("#replay input", "44")
            _take(folder, "replay", pages)
        with_webgl.close()
        without.close()


def _live(folder: Path, service: LiveService, with_webgl: Browser, without: Browser) -> None:
    with _pages(with_webgl, service.url) as pages:
        # In the 45th second it is on its second round.
        _when(pages, 40_000)
        _take(folder, "moving", pages, before=_in_motion)
        _take(folder, "still", pages, before=lambda page: page.wait_for_selector("#motion[data-level=good]"))
        service.bus.fail("unplugged for=0.8")
        _when(pages, 4000)
        _take(folder, "gap", pages)
        one = next(iter(pages.values()))
        one.locator(".fault-button").first.click()
        one.wait_for_selector(".fault-history li[data-level=good]", timeout=SOON_MS)
        _take(folder, "fault", pages, before=lambda page: _scroll(page, "#faults"))
        one.get_by_role("button", name="Calibrate", exact=True).click()
        one.wait_for_selector("#calibration .board[data-q]", timeout=SOON_MS)
        _when(pages, 5000)
        _take(folder, "calibration", pages, before=lambda page: _scroll(page, "#calibration"))
        _take(folder, "whole", pages, before=lambda page: _scroll(page, "body"), whole=True)
        _take(folder, "chip-lost", pages, before=lambda page: _lost(page, service))
    with _pages(without, service.url) as pages:
        next(iter(pages.values())).wait_for_selector("body:not(.stale)", timeout=SOON_MS)
        _take(folder, "no-webgl", pages, before=_in_motion)


@contextmanager
def _pages(browser: Browser, url: str) -> Iterator[dict[str, Page]]:
    """One for each size and colour."""
    pages = {}
    for size, (width, height) in SIZES.items():
        for colours in COLOURS:
            context = browser.new_context(
                viewport={"width": width, "height": height},
                device_scale_factor=2 if size == "phone" else 1,
                has_touch=size == "phone",
                color_scheme=colours,
            )
            pages[f"{size}-{colours}"] = page = context.new_page()
            page.goto(url)
            page.wait_for_selector("#board[data-drawn], #token", timeout=SOON_MS)
    yield pages
    for page in pages.values():
        page.context.close()


def _take(
    folder: Path,
    state: str,
    pages: dict[str, Page],
    *,
    before: Callable[[Page], object] = Page.bring_to_front,
    whole: bool = False,
) -> None:
    for name, page in pages.items():
        if whole and name.startswith("phone"):
            # Taller than Chromium can draw at once.
            continue
        before(page)
        page.screenshot(path=folder / f"{state}-{name}.png", full_page=whole)
    print(state)


def _when(pages: dict[str, Page], wait_ms: float) -> None:
    next(iter(pages.values())).wait_for_timeout(wait_ms)


def _in_motion(page: Page) -> None:
    """Until it moves and leans by 20 degrees or more."""
    page.bring_to_front()
    for _ in range(600):
        _, x, y, _ = (float(part) for part in (page.get_attribute("#board", "data-q") or "").split(","))
        if x * x + y * y > 0.03 and page.get_attribute("#motion", "data-level") == "move":
            return
        page.wait_for_timeout(100)


def _scroll(page: Page, selector: str) -> None:
    """So that it stands below the page's head."""
    page.eval_on_selector(selector, "(one) => one.scrollIntoView()")
    page.wait_for_timeout(200)


def _lost(page: Page, service: LiveService) -> None:
    """Each for itself, before the chip is given up: a machine that draws by software needs seconds for a picture."""
    page.bring_to_front()
    page.wait_for_selector("body:not(.stale)", timeout=SOON_MS)
    _scroll(page, "body")
    service.bus.fail("unplugged for=8")
    page.wait_for_selector(".stale #words li[data-level=bad]", timeout=SOON_MS)


def _wrong_token(page: Page) -> None:
    page.fill("#token", "some other words")
    page.keyboard.press("Enter")
    page.wait_for_selector("#login-says:not(:empty)")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit("give the directory for the pictures")
    main(Path(sys.argv[1]))
