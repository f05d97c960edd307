"""A page that is left open holds no more after a while than before."""

from __future__ import annotations

import pytest
from browser_memory import floor_mb, nodes, process_mb
from live_service import LiveService, live_motion


@pytest.fixture
def fast():
    """A hundred messages a second."""
    with LiveService(live_motion(), rate_hz=100.0) as service:
        yield service


@pytest.mark.slow
def test_a_thousand_messages_more_leave_nothing_behind(fast, look):
    page = look(fast.url, viewport={"width": 700, "height": 500}).is_live()
    page.wait_for_timeout(4000)
    before, nodes_before = floor_mb(page), nodes(page)
    page.wait_for_timeout(10_000)
    after, nodes_after = floor_mb(page), nodes(page)
    print(f"\nheap {before:.2f} MB, 1000 messages later {after:.2f} MB; {nodes_before} nodes, then {nodes_after}")
    assert after - before < 0.5
    assert abs(nodes_after - nodes_before) < 200


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_ten_minutes_leave_nothing_behind(service, chromium, look):
    page = look(service.url).is_live()
    page.wait_for_timeout(30_000)
    heaps = [floor_mb(page)]
    nodes_before, whole_before = nodes(page), process_mb(chromium, page)
    for _ in range(10):
        page.wait_for_timeout(60_000)
        heaps.append(floor_mb(page))
    whole = process_mb(chromium, page)
    print(
        f"\nheap in MB, each minute: {', '.join(f'{heap:.2f}' for heap in heaps)}; "
        f"nodes {nodes_before}, then {nodes(page)}; the page's process {whole_before:.0f}, then {whole:.0f} MB"
    )
    assert min(heaps[6:]) - min(heaps[:5]) < 0.3
    assert abs(nodes(page) - nodes_before) < 300
