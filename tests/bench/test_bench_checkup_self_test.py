"""The check-up's self-test: an axis that fails is named, and no board is blamed for what disturbed it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from boards import checked, chip, good_chip

from hw_fakes import FakeBus, FakeMpu6050, Sway
from quavelet.core.clock import Clock


def test_an_axis_that_fails_its_self_test_is_named() -> None:
    done = checked(chip(self_test_codes=(0, 0, 0, 0)))
    assert done.bad == ["self-test"]
    assert done["self-test"].advice.startswith("accel x does not respond at all")


def shaken_while_pushed(times: float) -> Callable[[Clock], FakeMpu6050]:
    """A chip whose gyroscope shows spikes the first so many times that its self-test is on."""

    def make(clock: Clock) -> FakeMpu6050:
        shaken, seen, before = good_chip(clock), 0, False

        def spoil(words: Any) -> Any:
            nonlocal seen, before
            pushed = bool(shaken.registers[0x1B] & 0x80)
            seen, before = seen + (pushed and not before), pushed
            if pushed and seen <= times:
                words = words.copy()
                words[::20, 5] += 4000
            return words

        shaken.spoil_words = spoil
        return shaken

    return make


def test_a_disturbed_self_test_is_measured_again_and_said_to_be() -> None:
    done = checked(shaken_while_pushed(1))
    assert done.bad == []
    assert done["self-test"].found.endswith("measured 2 times, since it was disturbed")


def test_a_board_that_moves_in_its_self_test_is_not_called_bad() -> None:
    done = checked(shaken_while_pushed(1e9))
    assert (done.bad, done["self-test"].found) == ([], "could not be done")
    assert done["self-test"].advice.startswith("the board moved")


def test_a_host_too_slow_for_the_self_test_does_not_blame_the_board() -> None:
    def slow(bus: FakeBus) -> None:
        transfer = bus._transfer

        def late(messages: Any) -> Any:
            bus.clock.sleep_until_ns(bus.clock.now_ns() + 90_000_000)
            return transfer(messages)

        bus._transfer = late  # type: ignore[method-assign]

    done = checked(prepare=slow)
    assert done["self-test"].found == "could not be done"
    assert done["registers"].figures["writes"] < 20
    assert done.error is None


def test_a_board_that_moves_is_not_put_to_its_self_test() -> None:
    assert "self-test" not in checked(chip(motion=Sway())).names
