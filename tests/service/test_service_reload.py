"""Settings read again while it runs: what is broken changes nothing, and the attitude never notices."""

from dataclasses import dataclass, field
from pathlib import Path

import msgspec
from service_bed import Bed

from hw_fakes import Sway
from quavelet.core.errors import SettingsError
from quavelet.mpu6050.config import ChipConfig
from quavelet.service.reload import changes, with_hot
from quavelet.settings import BusSettings, OutputSettings, Settings, load_settings

PLAIN = Settings(bus=BusSettings(name="fake:bed"))


@dataclass
class File:
    """What a reload finds."""

    settings: Settings | SettingsError = field(default_factory=lambda: PLAIN)

    def load(self) -> Settings:
        if isinstance(self.settings, SettingsError):
            raise self.settings
        return self.settings


def reloaded(found: Settings | SettingsError) -> Bed:
    """Ten seconds, with a reload at 6 s."""
    file = File()
    bed = Bed(Sway(), settings=PLAIN, load=file.load)

    def change() -> None:
        file.settings = found
        bed.service.reload()

    bed.clock.at(6.0, change)
    bed.run(until_s=10)
    return bed


def without_reload() -> Bed:
    bed = Bed(Sway(), settings=PLAIN)
    bed.run(until_s=10)
    return bed


def test_a_broken_file_keeps_the_old_settings_and_is_told() -> None:
    bed = reloaded(SettingsError("imu0.toml: chip: dlpf = 9 does not fit: give 0 to 6"))
    assert bed.service.settings == PLAIN
    told = [line for line in bed.said if "refused" in line]
    assert told == [
        "the settings are refused, the old ones stay in force: imu0.toml: chip: dlpf = 9 does not fit: give 0 to 6"
    ]
    assert "dlpf = 9 does not fit" in bed.heard.statuses[-2]


def test_systemd_hears_when_a_reload_begins_and_when_it_is_done() -> None:
    bed = reloaded(PLAIN)
    ((begun_s, begun),) = [(t, told) for t, told in bed.heard.told if "RELOADING" in told]
    assert begun["MONOTONIC_USEC"] == round(begun_s * 1e6)
    assert [t for t in bed.heard.times("READY") if t >= begun_s]
    assert bed.said == ["the settings were read again, and nothing has changed"]


def test_the_attitude_does_not_notice_a_reload() -> None:
    more = msgspec.structs.replace(PLAIN, output={"phone": OutputSettings(to="udp:127.0.0.1:5555")})
    assert reloaded(more).messages == without_reload().messages
    assert reloaded(SettingsError("no")).messages == without_reload().messages


def test_what_needs_a_restart_is_named_and_the_rest_is_in_force() -> None:
    chip = msgspec.structs.replace(PLAIN.chip, dlpf=4)
    new = msgspec.structs.replace(PLAIN, chip=chip, output={"phone": OutputSettings(to="udp:127.0.0.1:5555")})
    bed = reloaded(new)
    assert bed.said == [
        "the settings were read again; in force: output.phone; only after a restart: chip.dlpf",
    ]
    assert "only after a restart: chip.dlpf" in bed.heard.statuses[-2]
    assert bed.service.settings == msgspec.structs.replace(PLAIN, output=new.output)


def test_every_key_is_either_hot_or_needs_a_restart() -> None:
    old = msgspec.structs.replace(PLAIN, output={"a": OutputSettings(to="tcp:127.0.0.1:1")})
    new = Settings(
        bus=BusSettings(name="fake:other"),
        chip=ChipConfig(gyro_range_dps=250, accel_range_g=4, dlpf=3, sample_rate_hz=200.0),
        output={"a": OutputSettings(to="tcp:127.0.0.1:1", rate_hz=5.0), "b": OutputSettings(to="stdout")},
    )
    found = changes(old, new)
    assert found.hot == ("output.a.rate_hz", "output.b")
    assert found.restart == ("bus.name", "chip.gyro_range_dps")
    assert changes(with_hot(old, new), new).hot == ()


def test_a_reload_before_the_chip_is_there_does_not_say_ready(tmp_path: Path) -> None:
    path = tmp_path / "imu0.toml"
    path.write_text('[bus]\nname = "fake:bed"\n[service]\nwait_for_device = true\n')
    bed = Bed(wait=True, load=lambda: load_settings(path).settings)
    bed.plugged = False
    bed.clock.at(5.0, bed.service.reload)
    bed.run(until_s=20)
    assert bed.heard.times("READY") == [] == bed.heard.times("RELOADING")
    assert "the settings were read again, and nothing has changed" in bed.said
