"""The service as an object: driven on a virtual clock, through the fake chip."""

from itertools import pairwise
from pathlib import Path

import pytest
from service_bed import Bed

from hw_fakes import Sway
from quavelet.core.errors import DeviceLost, DeviceMissing
from quavelet.service.service import STDOUT


def test_a_run_gives_every_message_and_closes_what_takes_them() -> None:
    bed = Bed()
    bed.run(until_s=3)
    assert bed.service.streamed
    assert 270 <= len(bed.messages) <= 300
    assert bed.kept.closed


def test_a_reader_that_leaves_ends_the_run() -> None:
    bed = Bed(most=20)
    bed.service.run()
    assert isinstance(bed.service.messages.failures()[STDOUT], BrokenPipeError)


def test_a_stop_before_the_chip_is_there_ends_the_run_too() -> None:
    bed = Bed()
    bed.service.stop()
    bed.service.run()
    assert bed.kept.closed and not bed.messages


@pytest.mark.parametrize("wait", [False, True])
def test_a_chip_that_never_answers_leaves_no_empty_recording(tmp_path: Path, wait: bool) -> None:
    bed = Bed(record=tmp_path / "empty.qrec", wait=wait)
    bed.plugged = False
    if wait:
        bed.run(until_s=10)
    else:
        with pytest.raises(DeviceMissing):
            bed.run(until_s=10)
    assert not bed.service.streamed
    assert list(tmp_path.iterdir()) == []


def test_a_chip_that_is_not_there_is_an_error_at_once_where_nobody_asked_to_wait() -> None:
    bed = Bed()
    bed.plugged = False
    with pytest.raises(DeviceMissing):
        bed.service.run()
    assert bed.clock.now_ns() == 0


def test_a_bus_that_comes_after_an_hour_is_found_within_seconds_and_told_seldom() -> None:
    bed = Bed(wait=True)
    bed.plugged = False
    bed.clock.at(3600, lambda: setattr(bed, "plugged", True))
    bed.run(until_s=3606)
    assert 3600 < bed.messages[0].t_ns / 1e9 < 3602.5
    missing = [line for line in bed.said if "plug it in" in line]
    assert len(missing) == 6  # at once, and then every ten minutes
    assert bed.said[-1] == "the chip on fake:bed gives samples"
    # Systemd is asked for more time, sooner than it runs out, for as long as it takes.
    asked = bed.heard.times("EXTEND_TIMEOUT_USEC")
    assert max(b - a for a, b in pairwise(asked)) < 30
    assert asked[-1] > 3595
    assert "waiting for the chip; there is no bus fake:bed: plug it in" in bed.heard.statuses


def test_a_chip_that_does_not_acknowledge_at_the_start_is_waited_for() -> None:
    bed = Bed(wait=True)
    bed.wired = False
    bed.clock.at(5.0, lambda: setattr(bed, "wired", True))
    bed.run(until_s=9)
    assert any("no answer from address 0x68" in line for line in bed.said)
    assert bed.messages


def test_a_stop_is_heeded_while_the_chip_is_waited_for() -> None:
    bed = Bed(wait=True)
    bed.plugged = False
    bed.clock.at(100.0, bed.service.stop)
    bed.service.run()
    assert 100.0 <= bed.clock.now_ns() / 1e9 < 100.3


def test_a_chip_that_is_unplugged_for_a_moment_goes_on_and_systemd_hears_of_it() -> None:
    bed = Bed(Sway())
    bed.clock.at(6.0, lambda: bed.fault("unplugged for=3"))
    bed.run(until_s=15)
    assert [status for status in bed.heard.statuses if status.startswith("lost: no sample")]
    assert bed.heard.statuses[-2].startswith("running")
    assert bed.messages[-1].t_ns > 14.9e9
    assert len(bed.heard.times("READY")) == 1


def test_after_giving_up_it_is_an_error_so_that_systemd_starts_it_anew() -> None:
    bed = Bed(wait=True)
    bed.clock.at(6.0, lambda: bed.fault("unplugged"))
    with pytest.raises(DeviceLost):
        bed.service.run()
    assert "has given nothing for" in bed.heard.statuses[-1]
    assert bed.heard.times("STOPPING")
