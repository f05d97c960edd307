"""What was counted is said in words, and nothing that happened is left out."""

from __future__ import annotations

from dataclasses import fields

from quavelet.cli.counts import in_words
from quavelet.core.health import EXPECTED, WORDS, Health


def test_every_counter_has_words_of_its_own() -> None:
    names = {field.name for field in fields(Health)}
    assert names == {*WORDS, *EXPECTED}
    assert len(set(WORDS.values())) == len(WORDS)


def test_what_happened_is_told_with_its_number_and_name() -> None:
    health = Health(**{name: n for n, name in enumerate(WORDS, start=1)})
    told = list(in_words(health))
    for n, (name, words) in enumerate(WORDS.items(), start=1):
        assert f"{n} x {words} ({name})" in told
    assert len(told) == len(WORDS)


def test_of_a_good_run_nothing_is_told() -> None:
    assert list(in_words(Health(samples=1000, drains=500, fifo_empty=3))) == []
