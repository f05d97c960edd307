"""The room's README: its settings can be loaded, and every encoding is in its tables."""

from __future__ import annotations

import re
from pathlib import Path

import quavelet.sinks.encodings
from quavelet.settings import load_settings
from quavelet.sinks.encodings.ship_axes import HEADING_SIGMA_DEG, NO_ATTITUDE, NO_HEADING, NO_RATE
from quavelet.sinks.outputs import ENCODINGS

README = (Path(quavelet.sinks.encodings.__file__).parent / "README.md").read_text(encoding="utf-8")


def test_the_settings_shown_can_be_loaded_and_use_every_encoding(tmp_path):
    (toml,) = re.findall(r"```toml\n(.*?)```", README, re.DOTALL)
    path = tmp_path / "imu0.toml"
    path.write_text(toml, encoding="utf-8")
    settings = load_settings(path).settings
    assert {output.encoding for output in settings.output.values()} == set(ENCODINGS)
    assert settings.service.metrics


def test_every_encoding_has_its_line_of_doubt():
    _, doubt = README.split("## What each says of doubt")
    assert all(f"\n| `{name}` |" in doubt for name in ENCODINGS)


def test_the_flags_named_are_those_that_count():
    (heading,) = re.findall(r"A heading is doubtful with (.*?) or a sigma above (\d+) degrees", README)
    assert set(re.findall(r"`(\w+)`", heading[0])) == NO_HEADING and float(heading[1]) == HEADING_SIGMA_DEG
    (rate,) = re.findall(r"rate not to be used \(those, (.*?)\)", README)
    assert set(re.findall(r"`(\w+)`", rate)) == NO_RATE - NO_ATTITUDE
    (attitude,) = re.findall(r"roll and pitch not to be used \((.*?)\)", README)
    assert set(re.findall(r"`(\w+)`", attitude)) == NO_ATTITUDE
