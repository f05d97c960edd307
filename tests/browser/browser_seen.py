"""A page in a browser, all that the browser complained of, and what was drawn when."""

from __future__ import annotations

import re
import shutil
from time import monotonic_ns
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import numpy as np
from playwright.sync_api import Browser, Page, Playwright, Request

NAMES = ("chromium", "chromium-browser", "google-chrome")
WEBGL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
NO_WEBGL = ("--disable-3d-apis",)
OF_THE_DRIVER = re.compile(r"GL Driver Message .* GPU stall due to ReadPixels")
"""What Chromium says of its own software renderer when a picture of the page is taken."""
REFUSED = re.compile(r"WebSocket connection to 'ws://[^']*' failed|net::ERR_CONNECTION_REFUSED")
"""What Chromium says, and no script can prevent, where nobody listens."""
_MESSAGE = re.compile(r'\{"is":"message".*?"t_ns":(\d+)')

# Each drawn frame as it is announced by the page: when, of which sample, and how it was drawn.
_RECORD = """() => {
  const board = document.querySelector("#board"), data = board.dataset;
  window.drawnFrames = [];
  new MutationObserver(() => window.drawnFrames.push([performance.now(), Number(data.tNs), data.q]))
    .observe(board, { attributes: true, attributeFilter: ["data-drawn"] });
}"""


def chromium_path() -> str | None:
    """None where there is no Chromium."""
    return next(filter(None, map(shutil.which, NAMES)), None)


def launch(playwright: Playwright, *, webgl: bool, more: tuple[str, ...] = ()) -> Browser:
    return playwright.chromium.launch(
        executable_path=chromium_path(), args=["--no-sandbox", *(WEBGL if webgl else NO_WEBGL), *more]
    )


class Drawn(NamedTuple):
    """Frames as they were drawn: when, by the clock of the samples, of which sample, and the orientation (N, 4)."""

    at_ns: np.ndarray[Any, np.dtype[np.int64]]
    t_ns: np.ndarray[Any, np.dtype[np.int64]]
    q: np.ndarray[Any, np.dtype[np.float64]]

    @property
    def latency_ms(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        """From a sample to the end of the script that drew it; the screen has it a frame later."""
        return (self.at_ns - self.t_ns) / 1e6


class Seen:
    """A page of `url` in a context of its own. `allowed` is what the browser may say all the same."""

    def __init__(self, browser: Browser, url: str, *, allowed: re.Pattern[str] | None = None, **context: Any) -> None:
        self.origins = {urlsplit(url).netloc}
        self.complaints: list[str] = []
        self.allowed = allowed
        self.context = browser.new_context(**{"viewport": {"width": 1280, "height": 800}} | context)
        self.page: Page = self.context.new_page()
        self.page.on("console", lambda line: self._console(line.type, line.text))
        self.page.on("pageerror", lambda error: self.complaints.append(f"mistake: {error}"))
        self.context.on("request", self._request)
        self.page.on("websocket", lambda socket: self._socket(socket.url))
        self.page.goto(url)

    def close(self) -> list[str]:
        """What the browser complained of."""
        self.context.close()
        return self.complaints

    def is_live(self, *, within_s: float = 60.0) -> Page:
        """The page, once it draws."""
        self.page.wait_for_selector("#board[data-drawn]", timeout=1000 * within_s)
        # No wait_for_function: it evaluates text, which the page's policy forbids.
        self.page.wait_for_selector("body:not(.stale)", timeout=1000 * within_s)
        return self.page

    def hear(self, times_ns: list[int]) -> None:
        """Keep the time of each message that comes to the page by its websocket, from the next one that it opens."""

        def heard(frame: str | bytes) -> None:
            found = _MESSAGE.match(frame) if isinstance(frame, str) else None
            if found:
                times_ns.append(int(found[1]))

        self.page.on("websocket", lambda socket: socket.on("framereceived", heard))

    def record(self) -> None:
        """Keep the frames from here on."""
        self.page.evaluate(_RECORD)

    def drawn(self) -> Drawn:
        """The frames since `record`."""
        rows = self.page.evaluate("window.drawnFrames")
        at_ms, t_ns, q = zip(*rows, strict=True)
        return Drawn(
            (np.array(at_ms) * 1e6 + self.offset_ns()).astype(np.int64),
            np.array(t_ns, dtype=np.int64),
            np.array([[float(part) for part in one.split(",")] for one in q]),
        )

    def offset_ns(self) -> int:
        """CLOCK_MONOTONIC less the page's performance.now(), by the quickest of some questions."""
        trips = []
        for _ in range(30):
            before_ns = monotonic_ns()
            there_ms = self.page.evaluate("performance.now()")
            after_ns = monotonic_ns()
            trips.append((after_ns - before_ns, (before_ns + after_ns) // 2 - round(there_ms * 1e6)))
        return min(trips)[1]

    def _console(self, kind: str, text: str) -> None:
        # "verbose" is advice of the browser to authors, which is hidden from who looks into the console, too.
        if kind == "verbose" or OF_THE_DRIVER.search(text) or (self.allowed and self.allowed.search(text)):
            return
        self.complaints.append(f"{kind}: {text}")

    def _request(self, request: Request) -> None:
        if urlsplit(request.url).scheme != "data" and urlsplit(request.url).netloc not in self.origins:
            self.complaints.append(f"request: {request.url}")

    def _socket(self, url: str) -> None:
        if urlsplit(url).netloc not in self.origins:
            self.complaints.append(f"websocket: {url}")
