"""The transports' README: its settings load, and what Telegraf is told fits what is published."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import msgspec
from output_plans import MESSAGE, mqtt_plan
from paho.mqtt.client import topic_matches_sub

import quavelet.sinks.transports
from quavelet.settings import load_settings
from quavelet.sinks.identity import topic_of
from quavelet.sinks.outputs import make_encoding

README = (Path(quavelet.sinks.transports.__file__).parent / "README.md").read_text(encoding="utf-8")
HOME, DATABASE, TELEGRAF = re.findall(r"```toml\n(.*?)```", README, re.DOTALL)


def test_the_settings_shown_can_be_loaded(tmp_path: Path) -> None:
    path = tmp_path / "imu.toml"
    for text in (HOME, DATABASE):
        path.write_text(text, encoding="utf-8")
        load_settings(path)


def test_telegraf_is_told_topics_and_tags_that_fit() -> None:
    telegraf = tomllib.loads(TELEGRAF)
    (source,) = telegraf["inputs"]["mqtt_consumer"]
    plan = mqtt_plan("mqtt:broker.example", encoding="influx", home_assistant=False)
    levels = f"{topic_of(plan, host='mast')}/attitude".split("/")
    (subscribed,) = source["topics"]
    assert topic_matches_sub(subscribed, "/".join(levels))
    (parsing,) = source["topic_parsing"]
    assert topic_matches_sub(parsing["topic"], "/".join(levels))
    named = dict(zip(parsing["tags"].split("/"), levels, strict=True))
    assert named["host"] == "mast"
    assert source["data_format"] == plan.settings.encoding
    line = make_encoding(plan).encode(msgspec.structs.replace(MESSAGE, src="linux:1")).decode()
    assert line.startswith("attitude,name=imu,src=linux:1,yaw=relative ")
    # The topic gives the tag that the line has not: two machines' services of one name stay apart.
    assert "host=" not in line
