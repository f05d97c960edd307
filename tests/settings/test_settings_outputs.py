"""[output.NAME]: what is read of it, and that each mistake is refused by the name of its key."""

from pathlib import Path

import pytest

from quavelet.core.errors import SettingsError
from quavelet.settings import Destination, OutputSettings, load_settings

GOOD = {
    "stdout": Destination("stdout"),
    "unix:/run/imu.sock": Destination("unix", path="/run/imu.sock"),
    "tcp:0.0.0.0:5555": Destination("tcp", host="0.0.0.0", port=5555),
    "tcp:[::1]:0": Destination("tcp", host="::1", port=0),
    "udp:[ff02::1%eth0]:5555": Destination("udp", host="ff02::1%eth0", port=5555),
    "mqtt:broker.local": Destination("mqtt", host="broker.local", port=1883),
    "mqtts:10.0.0.1:18883": Destination("mqtts", host="10.0.0.1", port=18883),
}
BAD = [
    ('to = "carrier pigeon"', "output.x: to = 'carrier pigeon'"),
    ('to = "udp:"', "output.x: to = 'udp:'"),
    ('to = "udp:host"', "output.x: to = 'host' is no HOST:PORT"),
    ('to = "udp:host:99999"', "no port 99999"),
    ('to = "udp:host:0"', "no port 0"),
    ('to = "udp:ho\\nst:5"', "is no HOST:PORT"),
    ('to = "udp:::1:5"', "is no HOST:PORT"),
    ('to = "unix:' + 200 * "a" + '"', "no path of a socket"),
    ('to = "unix:a\\u0000b"', "no path of a socket"),
    ("rate_hz = 1.0", "output.x: Object missing required field `to`"),
    ('to = "stdout"\nrate_hz = 1e9', "output.x: rate_hz = 1e+09"),
    ('to = "stdout"\nrate_hz = nan', "output.x.rate_hz = nan is not a finite number"),
    ('to = "stdout"\nreaders = 0', "output.x: readers = 0"),
    ('to = "stdout"\nrate = 1', "unknown key output.x.rate: did you mean rate_hz? [output.x] has"),
    ('to = "stdout"\nrate_hz = "fast"', "output.x.rate_hz: Expected `float`"),
    ('to = "tcp:h:1"\nencoding = "opentrack"', "encoding = 'opentrack' does not go with to = 'tcp'"),
    ('to = "mqtt:h"\nencoding = "mavlink"', "encoding = 'mavlink' does not go with to = 'mqtt'"),
    ('to = "tcp:h:1"\n[output.x.mqtt]\nqos = 0', "the table mqtt does not go with to = 'tcp'"),
    ('to = "mqtt:h"\n[output.x.mqtt]\nqos = 3', "output.x.mqtt.qos: Invalid enum value 3"),
    ('to = "mqtt:h"\n[output.x.mqtt]\ntopic = "imu/+/x"', "output.x.mqtt: topic = 'imu/+/x'"),
    ('to = "mqtt:h"\n[output.x.mqtt]\ntopic = "$SYS/x"', "output.x.mqtt: topic = '$SYS/x'"),
    ('to = "mqtt:h"\nmqtt = 1', "output.x.mqtt is a table"),
]


@pytest.mark.parametrize("to", GOOD)
def test_a_place_is_taken_apart(to: str) -> None:
    assert OutputSettings(to=to).destination == GOOD[to]


@pytest.mark.parametrize(("text", "words"), BAD)
def test_a_mistake_in_an_output_is_told_with_file_and_key(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "imu.toml"
    path.write_text(f"[output.x]\n{text}\n")
    with pytest.raises(SettingsError) as told:
        load_settings(path)
    assert str(told.value).startswith(f"{path}: ")
    assert words in str(told.value)


@pytest.mark.parametrize("name", ["a/b", "", "ä", 33 * "n", "a b"])
def test_an_output_with_a_name_that_no_topic_or_file_can_have_is_refused(name: str, tmp_path: Path) -> None:
    path = tmp_path / "imu.toml"
    path.write_text(f'[output."{name}"]\nto = "stdout"\n')
    with pytest.raises(SettingsError, match="an output's name has 1 to 32"):
        load_settings(path)


def test_two_outputs_on_stdout_would_mix_their_lines(tmp_path: Path) -> None:
    path = tmp_path / "imu.toml"
    path.write_text('[output.a]\nto = "stdout"\n[output.b]\nto = "stdout"\n')
    with pytest.raises(SettingsError, match="'a' and 'b' all go to stdout"):
        load_settings(path)


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ("", "outputs 'a' and 'b' have one topic at h: give one an mqtt.topic"),
        ('mqtt.topic = "other"', "outputs 'a' and 'b' announce one board"),
        ('mqtt.topic = "other"\nmqtt.home_assistant = false', ""),
        ('mqtt.topic = "other"\nencoding = "influx"', "write mqtt.home_assistant = false"),
        ("rate_hz = 0.1", "rate_hz = 0.1 is too slow for mqtt.expire_after_s = 10"),
    ],
)
def test_two_outputs_at_one_broker_would_write_over_each_other(tables: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "imu.toml"
    path.write_text(f'[output.a]\nto = "mqtt:h"\n[output.b]\nto = "mqtts:h"\n{tables}\n')
    if not words:
        assert len(load_settings(path).settings.output) == 2
        return
    with pytest.raises(SettingsError) as told:
        load_settings(path)
    assert words in str(told.value)


def test_each_value_of_an_output_has_an_origin(tmp_path: Path) -> None:
    path = tmp_path / "imu.toml"
    path.write_text('[output.home]\nto = "mqtt:here"\n[output.home.mqtt]\nqos = 0\n')
    loaded = load_settings(path)
    assert loaded.settings.output["home"].mqtt.qos == 0
    assert loaded.origin["output.home.to"] == loaded.origin["output.home.mqtt.qos"] == str(path)
    assert loaded.origin["output.home.rate_hz"] == loaded.origin["output.home.mqtt.topic"] == "default"
