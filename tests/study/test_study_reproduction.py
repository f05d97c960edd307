"""What is said of a paper is what its rows say."""

from __future__ import annotations

import re

import fake_experiments as fake

from quavelet.drawing.page import Section, html_page
from quavelet.study import reproduction
from quavelet.study.experiment import Effort, Result, silent

RESULT = fake.well(Effort.FULL, silent)


def text_of(*sections: Section) -> str:
    return re.sub(r"<[^>]*>", " ", html_page("Papers", (), sections, foot=""))


def test_the_page_shows_every_row():
    text = text_of(reproduction.section(fake.WELL, RESULT), reproduction.summary([(fake.WELL, RESULT)]))
    for words in (
        ".0412",
        "0.601 deg",
        "refuted",
        "0.146 to 0.178",
        "An accelerometer has more noise; reading: none",
        "2 of 2",
        "Eq. 4 lacks a factor 2.",
    ):
        assert words in text


def test_the_summary_counts_and_names_what_is_outside():
    text = text_of(reproduction.summary([(fake.OUTSIDE, Result((fake.GOOD, fake.BAD)))]))
    assert "1 of 2; not: 0b" in text
