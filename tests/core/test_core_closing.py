"""What is used in a `with` block is closed at its end, also where that is an error."""

from __future__ import annotations

import pytest

from quavelet.core.closing import Closing


class Door(Closing):
    def __init__(self):
        self.closed = 0

    def close(self):
        self.closed += 1


@pytest.mark.parametrize("fails", [False, True])
def test_block_leaves_it_open_or_swallows_the_error(fails):
    door = Door()
    if fails:
        with pytest.raises(ZeroDivisionError), door as same:
            assert same is door
            raise ZeroDivisionError
    else:
        with door as same:
            assert same is door and not door.closed
    assert door.closed == 1


def test_thing_without_a_way_to_close_it_cannot_be_made():
    class Wall(Closing):
        pass

    with pytest.raises(TypeError, match="close"):
        Wall()
