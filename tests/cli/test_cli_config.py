"""`quavelet config` shows every setting with its origin, and what it prints is a settings file."""

import json
import tomllib
from collections import defaultdict
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
from program import quavelet

from quavelet.attitude.params import FilterParams
from quavelet.cli import exits
from quavelet.cli.config import as_toml
from quavelet.settings import (
    BusSettings,
    LoadedSettings,
    MqttSettings,
    OutputSettings,
    Settings,
    StartSettings,
    load_settings,
    parse_settings,
)
from quavelet.settings.reference_page import reference_page

GAIN = st.floats(0.0, 100.0)
PRINTABLE = st.text(max_size=128).filter(str.isprintable)
SETTINGS = st.builds(
    Settings,
    bus=st.builds(BusSettings, name=st.text(), address=st.integers(0x08, 0x77)),
    start=st.builds(
        StartSettings,
        still_s=st.floats(0.5, 60.0),
        gyro_bias_dps=st.just(()) | st.tuples(*[st.floats(-50.0, 50.0)] * 3),
    ),
    output=st.dictionaries(
        st.from_regex(r"[A-Za-z0-9_-]{1,32}", fullmatch=True),
        st.builds(
            OutputSettings, to=st.just("tcp:[::1]:5555") | st.just('unix:/run/\u00e4 "x"'), rate_hz=st.floats(0.0, 1e3)
        )
        | st.builds(
            OutputSettings, to=st.just("mqtt:here"), mqtt=st.builds(MqttSettings, user=PRINTABLE, qos=st.just(2))
        ),
        max_size=3,
    ).filter(lambda outputs: len({output.to for output in outputs.values()}) == len(outputs)),
    filter=st.builds(FilterParams, kind=st.just("pid"), kp=GAIN, ki=GAIN, kd=GAIN, integral_limit_rad_s=GAIN),
)


@given(SETTINGS, st.text())
def test_what_it_prints_loads_as_the_same_settings(settings: Settings, origin: str) -> None:
    origins = defaultdict(lambda: origin)
    text = as_toml(LoadedSettings(settings, origins))
    assert parse_settings(tomllib.loads(text), where="printed") == settings


def test_each_value_is_shown_with_its_origin(tmp_path: Path) -> None:
    path = tmp_path / "imu.toml"
    path.write_text('[bus]\nname = "linux:3"\naddress = 0x69\n[chip]\ndlpf = 4\n')
    arguments = ("config", "--config", path, "--bus", "fake:still")
    done = quavelet(*arguments)
    assert (done.code, done.err) == (exits.OK, "")
    # The first of each name: [bus] and [chip] come before the others.
    shown = dict(line.split(" = ", 1) for line in reversed(done.lines) if " = " in line)
    assert shown["name"].split() == ['"fake:still"', "#", "command", "line"]
    assert shown["address"].split() == ["0x69", "#", str(path)]
    assert shown["dlpf"].split() == ["4", "#", str(path)]
    assert shown["still_s"].split() == ["2.0", "#", "default"]
    origins = json.loads(quavelet(*arguments, "--json").out)
    assert origins["bus"]["name"] == {"value": "fake:still", "origin": "command line"}
    assert origins["chip"]["dlpf"] == {"value": 4, "origin": str(path)}

    printed = tmp_path / "printed.toml"
    printed.write_text(done.out)
    assert load_settings(printed).settings == load_settings(path, options={"bus.name": "fake:still"}).settings


def test_the_reference_is_printed_whatever_the_settings(tmp_path: Path) -> None:
    path = tmp_path / "imu.toml"
    path.write_text("[chip]\ndlpf = 4\n")
    done = quavelet("config", "--reference", "--config", path)
    assert (done.code, done.err) == (exits.OK, "")
    assert done.out == reference_page()
