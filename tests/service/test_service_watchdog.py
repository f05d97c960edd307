"""What systemd hears: READY, WATCHDOG and STATUS say what the chip's samples say, and nothing else does."""

import re
from itertools import pairwise

from service_bed import WATCHDOG_S, Bed

from hw_fakes import Still, Sway


def test_ready_comes_with_the_first_attitude_that_is_to_be_trusted() -> None:
    bed = Bed(Sway())
    bed.run(until_s=10)
    (ready,) = bed.heard.times("READY")
    trusted = next(m for m in bed.messages if "settling" not in m.flags)
    assert any("settling" in m.flags for m in bed.messages[:10])
    assert 0.0 <= ready - trusted.t_ns / 1e9 < 0.02


def test_a_chip_that_is_frozen_from_the_start_never_is_ready_and_gets_no_more_time() -> None:
    bed = Bed()
    bed.clock.at(0.05, lambda: bed.fault("frozen"))
    bed.run(until_s=15)
    assert bed.messages and bed.heard.times("READY") == []
    assert max(bed.heard.times("EXTEND_TIMEOUT_USEC"), default=0.0) < 5.0
    assert bed.heard.statuses[-2].startswith("lost: the chip is stuck")


def test_a_loop_that_lives_feeds_the_watchdog_well_within_its_time() -> None:
    bed = Bed()
    bed.run(until_s=25)
    fed = bed.heard.times("WATCHDOG")
    assert max(b - a for a, b in pairwise(fed)) <= WATCHDOG_S / 2 + 0.1
    assert len(fed) <= 25 / (WATCHDOG_S / 2) + 1


def test_a_chip_that_freezes_starves_the_watchdog() -> None:
    bed = Bed()
    bed.clock.at(5.0, lambda: bed.fault("frozen"))
    bed.run(until_s=5 + WATCHDOG_S)
    # Samples went on all the time: their coming is not enough.
    assert bed.messages[-1].t_ns > (5 + WATCHDOG_S - 0.1) * 1e9
    assert max(bed.heard.times("WATCHDOG")) < 7.0
    assert bed.heard.statuses[-2].startswith("lost: the chip is stuck")


def test_a_chip_that_is_gone_starves_the_watchdog() -> None:
    bed = Bed()
    bed.clock.at(5.0, lambda: bed.fault("unplugged for=8"))
    bed.run(until_s=13)
    assert max(bed.heard.times("WATCHDOG")) <= 5.0


def test_a_ready_that_systemd_was_too_busy_for_is_said_again() -> None:
    bed = Bed()
    bed.heard.deaf = True
    bed.clock.at(8.0, lambda: setattr(bed.heard, "deaf", False))
    bed.run(until_s=9)
    (ready,) = bed.heard.times("READY")
    assert 8.0 <= ready < 8.1


def test_a_status_comes_every_few_seconds_in_words() -> None:
    bed = Bed(Still(roll_deg=12.0))
    bed.run(until_s=16)
    assert 3 <= len(bed.heard.statuses) <= 8
    assert re.match(r"running; roll 1\d\.\d, pitch .* deg \(relative\) on fake:bed, 20", bed.heard.statuses[-2])
    assert bed.heard.statuses[-1] == "stopping"
    assert bed.heard.times("STOPPING")


def test_a_clock_that_jumps_ahead_is_no_reason_to_starve_or_to_end() -> None:
    bed = Bed()
    bed.clock.at(10.0, lambda: bed.clock.advance_ns(3_600_000_000_000))
    bed.run(until_s=3640)
    after = [t_s for t_s in bed.heard.times("WATCHDOG") if t_s > 3610]
    assert after and bed.heard.statuses[-2].startswith("running")
    assert bed.service.imu is not None and bed.service.imu.loop.stats.missed >= 3_599 * 100
