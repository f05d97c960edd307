"""What can be done from the page, done as a person does it: yaw, recordings, the mounting, a calibration."""

from __future__ import annotations

import subprocess

import numpy as np
import pytest
from live_service import PROGRAM, LiveService, live_motion

from hw_fakes import Show
from hw_fakes.world.motion_show import Move
from quavelet.core.quaternion import angle_between, inclination_between

SOON_MS = 60_000


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("recordings")


@pytest.fixture(scope="module")
def service(folder):
    with LiveService(live_motion(), recordings=str(folder)) as service:
        yield service


def button(page, place, name):
    return page.locator(place).get_by_role("button", name=name, exact=True)


@pytest.mark.slow
def test_yaw_counts_from_where_it_was_set_to_zero_and_the_tilt_stays(service, look):
    seen = look(service.url)
    page = seen.is_live()

    def off_deg():
        page.wait_for_timeout(1000)
        seen.record()
        page.wait_for_timeout(1500)
        drawn = seen.drawn()
        truth = service.truth(drawn.t_ns)
        return np.degrees(angle_between(truth, drawn.q)), np.degrees(inclination_between(truth, drawn.q))

    # It is turned to and fro: somewhere else than where it began.
    for _ in range(100):
        if abs(float(page.inner_text("#yaw").replace("−", "-"))) > 20:
            break
        page.wait_for_timeout(100)
    button(page, "#zero", "Yaw counts from here").click()
    undo = button(page, "#zero", "Undo")
    undo.wait_for()
    page.wait_for_selector(".toast[data-level=good]")
    turned, tilted = off_deg()
    print(
        f"\nzeroed {np.median(turned):.1f} deg from before, +-{np.ptp(turned) / 2:.2f}; tilt off {tilted.max():.2f} deg"
    )
    assert np.median(turned) > 5
    assert np.ptp(turned) < 1
    assert tilted.max() < 1
    undo.click()
    undo.wait_for(state="hidden")
    assert off_deg()[0].max() < 1


def test_a_recording_is_begun_ended_downloaded_replayed_and_deleted(service, folder, look, tmp_path):
    page = look(service.url, accept_downloads=True).is_live()
    button(page, "#record", "Record").click()
    stop = button(page, "#record", "Stop recording")
    stop.wait_for()
    page.wait_for_timeout(2500)
    assert page.inner_text("#record .note").startswith("Recording ")
    stop.click()
    link = page.locator("#record .files a")
    link.wait_for()
    with page.expect_download() as download:
        link.click()
    path = tmp_path / download.value.suggested_filename
    download.value.save_as(path)
    kept = list(folder.iterdir())
    assert [path.read_bytes()] == [one.read_bytes() for one in kept]
    done = subprocess.run([*PROGRAM, "replay", str(path), "--json"], capture_output=True, timeout=120, check=True)
    lines = done.stdout.splitlines()
    print(f"\n{path.name}: {path.stat().st_size} bytes, {len(lines)} messages when replayed")
    assert len(lines) > 50
    page.locator("#record .files button").click()
    page.get_by_role("button", name="Really delete").click()
    link.wait_for(state="detached")
    assert list(folder.iterdir()) == []


@pytest.mark.slow
def test_the_mounting_is_found_right_by_two_poses(look):
    lifted = Move(0, -30, 0, 1.0, 4.0), Move(0, 0, 0, 1.0, 2.0)
    with LiveService(Show(start_s=5.0, moves=lifted, sway_s=0.5, sway_deg=(0, 0, 0), rest_s=3.0)) as service:
        page = look(service.url).is_live()
        button(page, "#mounting", "Check the mounting").click()
        page.wait_for_selector("#mounting .asked:has-text('Lay it')")
        for _ in range(60):
            button(page, "#mounting", "Done, go on").click()
            page.wait_for_timeout(500)
            if "Lift" in page.inner_text("#mounting .ask"):
                break
        page.wait_for_selector("#mounting .verdict[data-level=good]", timeout=SOON_MS)
        print("\n" + page.inner_text("#mounting .verdict"))
        page.goto("about:blank")


@pytest.mark.slow
def test_a_calibration_shows_what_is_asked_and_how_the_board_lies_and_can_be_stopped(service, look):
    page = look(service.url).is_live()
    button(page, "#calibration", "Calibrate").click()
    page.wait_for_selector("#calibration .instruction:not(:empty)", timeout=SOON_MS)
    page.wait_for_selector("#calibration .board[data-q]", timeout=SOON_MS)
    assert page.locator("#calibration .steps li").count() > 2
    assert page.locator("#calibration .steps [aria-current=step]").count() == 1
    button(page, "#calibration", "Stop").click()
    button(page, "#calibration", "Stop").wait_for(state="hidden", timeout=SOON_MS)
    # What goes on beside it is not disturbed.
    assert page.inner_text("#link-text") == "live"


@pytest.mark.slow
def test_a_calibration_ends_with_a_verdict_in_words(service, look):
    page = look(service.url).is_live()
    page.locator("#calibration button").filter(visible=True).first.click()
    page.wait_for_selector("#calibration .result .verdict", timeout=240_000)
    print("\n" + page.inner_text("#calibration .result"))
    assert page.get_attribute("#calibration .result .verdict", "data-level") == "good"
    assert page.locator("#calibration .result li").count() > 3
