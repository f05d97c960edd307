"""The strict fake is strict."""

from __future__ import annotations

import pytest

from hw_fakes import ScriptedBus, Write, WriteRead
from quavelet.bus.faults import bus_error
from quavelet.core.errors import DeviceMissing

SCRIPT = [Write(0x68, b"\x6b\x80"), WriteRead(0x68, b"\x75", b"\x68")]


def test_script_played_to_the_end_passes():
    with ScriptedBus(SCRIPT) as bus:
        bus.write(0x68, b"\x6b\x80")
        assert bus.write_read(0x68, b"\x75", 1) == b"\x68"
    assert bus.name == "fake:script"


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda bus: bus.write(0x68, b"\x6b\x01"), "expected a write of 6b 80 to 0x68, got a write of 6b 01 to 0x68"),
        (lambda bus: bus.write(0x69, b"\x6b\x80"), "got a write of 6b 80 to 0x69"),
        (lambda bus: bus.write_read(0x68, b"\x6b\x80", 1), "got a write of 6b 80 to 0x68, then read of 1"),
    ],
)
def test_any_deviation_says_what_was_expected(call, text):
    bus = ScriptedBus(SCRIPT)
    with pytest.raises(AssertionError) as caught:
        call(bus)
    assert text in str(caught.value)


def test_read_of_another_length_deviates():
    bus = ScriptedBus([WriteRead(0x68, b"\x75", b"\x68")])
    with pytest.raises(AssertionError, match=r"read of 1, got .* read of 2"):
        bus.write_read(0x68, b"\x75", 2)


def test_leftovers_fail_the_test():
    with pytest.raises(AssertionError, match="1 transactions did not happen, the first: write of 75"):  # noqa: SIM117
        with ScriptedBus(SCRIPT) as bus:
            bus.write(0x68, b"\x6b\x80")


def test_leftovers_do_not_hide_the_error_that_caused_them():
    with pytest.raises(KeyError), ScriptedBus(SCRIPT):
        raise KeyError


def test_more_than_the_script_fails():
    bus = ScriptedBus([])
    bus.done()
    with pytest.raises(AssertionError, match="expected nothing more"):
        bus.write(0x68, b"\x00")


def test_errors_are_raised_as_written():
    error = bus_error(121, bus="fake:script", address=0x68)
    with ScriptedBus([Write(0x68, b"\x6b\x01", error=error), WriteRead(0x68, b"\x75", error=error, n=1)]) as bus:
        for call in (lambda: bus.write(0x68, b"\x6b\x01"), lambda: bus.write_read(0x68, b"\x75", 1)):
            with pytest.raises(DeviceMissing):
                call()


def test_closed_script_refuses():
    bus = ScriptedBus(SCRIPT)
    bus.close()
    with pytest.raises(AssertionError, match="closed"):
        bus.write(0x68, b"\x6b\x80")


def test_read_without_an_answer_is_no_script():
    with pytest.raises(ValueError, match="no answer"):
        ScriptedBus([WriteRead(0x68, b"\x75")])
