"""A path with the home of nobody must be a file that is not there, not a traceback."""

from pathlib import Path

import pytest

from quavelet.core.paths import expanded


def test_the_home_of_nobody_stays_as_it_is() -> None:
    assert expanded("~nobody-of-that-name/x") == Path("~nobody-of-that-name/x")


def test_the_own_home_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/somewhere")
    assert expanded("~/x") == Path("/somewhere/x")
    assert expanded("/a/~/x") == Path("/a/~/x")
