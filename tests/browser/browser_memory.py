"""How much a page holds."""

from __future__ import annotations

from pathlib import Path

from playwright.sync_api import Browser, Page


def heap_mb(page: Page) -> float:
    """Of its scripts, with all that nobody holds any more thrown away; arrays of numbers count."""
    session = page.context.new_cdp_session(page)
    # What is freed in one round lets go of more.
    for _ in range(3):
        session.send("HeapProfiler.collectGarbage")
    used = session.send("Runtime.getHeapUsage")
    session.detach()
    return float(used["usedSize"] + used.get("backingStorageSize", 0)) / 1e6


def floor_mb(page: Page, *, looks: int = 5) -> float:
    """The least of some looks: what is under way at one of them is up to 0.8 MB, and only what is kept raises it."""
    least = heap_mb(page)
    for _ in range(looks - 1):
        page.wait_for_timeout(300)
        least = min(least, heap_mb(page))
    return least


def nodes(page: Page) -> int:
    """Elements and texts, listeners' too, that are held, in the page or not."""
    session = page.context.new_cdp_session(page)
    session.send("HeapProfiler.collectGarbage")
    counted = session.send("Memory.getDOMCounters")
    session.detach()
    return int(counted["nodes"] + counted["jsEventListeners"])


def process_mb(browser: Browser, page: Page) -> float:
    """Of the process that shows the page alone (proportional set size): program, pictures and all."""
    del page
    session = browser.new_browser_cdp_session()
    processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
    session.detach()
    sizes = [_pss_mb(one["id"]) for one in processes if one["type"] == "renderer"]
    return max(sizes)


def _pss_mb(pid: int) -> float:
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1]) / 1000
    raise ValueError("no Pss")
