"""The unit, the sample configuration and the udev rule, as far as they can be judged without running them."""

import shutil
import subprocess
import sys
import tomllib
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest

from quavelet.cli import exits
from quavelet.loop.kernel import DMA_LATENCY_PATH
from quavelet.service.program import Program
from quavelet.settings import Settings, load_settings
from quavelet.settings.reference import example

FOLDER = Path(__file__).parents[2] / "systemd"
UNIT = FOLDER / "quavelet@.service"
PROGRAM = "/opt/quavelet/venv/bin/quavelet"
EXPOSURE_LIMIT, NETWORK_EXPOSURE_LIMIT = 1.5, 2.0

needs_analyze = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")


@pytest.fixture
def installed_unit(tmp_path: Path) -> Path:
    """The unit with a program that exists on this machine, for systemd looks whether it can be executed."""
    text = UNIT.read_text()
    assert f"ExecStart={PROGRAM} " in text
    path = tmp_path / UNIT.name
    path.write_text(text.replace(PROGRAM, sys.executable))
    return path


def with_drop_ins(unit: Path, names: tuple[str, ...]) -> None:
    """A drop-in is read as if it stood at the unit's end."""
    unit.write_text("\n".join([unit.read_text(), *((FOLDER / name).read_text() for name in names)]))


def directives() -> list[tuple[str, str]]:
    lines = [line.strip() for line in UNIT.read_text().splitlines()]
    return [
        (key, value)
        for key, equals, value in (line.partition("=") for line in lines if line and line[0] not in "#;[")
        if equals
    ]


@needs_analyze
@pytest.mark.parametrize("drop_ins", [(), ("network.conf",), ("gpio.conf",), ("network.conf", "gpio.conf")], ids=str)
def test_systemd_ignores_no_line_of_the_unit(installed_unit: Path, drop_ins: tuple[str, ...]) -> None:
    with_drop_ins(installed_unit, drop_ins)
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", installed_unit], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")  # an unknown key is told, and the exit code is 0 all the same


@needs_analyze
def test_a_program_in_a_folder_with_spaces_can_be_started(tmp_path: Path) -> None:
    program = tmp_path / "my venv" / "bin" / "quavelet"
    program.parent.mkdir(parents=True)
    program.symlink_to(sys.executable)
    path = tmp_path / UNIT.name
    commands = ["systemd-analyze", "verify", "--man=no", path]
    for written, told in ((Program(program).in_unit, ""), (str(program), f"{tmp_path}/my")):
        path.write_text(UNIT.read_text().replace(PROGRAM, written))
        done = subprocess.run(commands, capture_output=True, text=True, check=False)
        assert (done.stderr == "") == (told == "") and told in done.stderr


@needs_analyze
def test_verify_would_tell_of_an_unknown_key(installed_unit: Path) -> None:
    installed_unit.write_text(installed_unit.read_text().replace("RestartSec=", "RestartSecs="))
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", installed_unit], capture_output=True, text=True, check=False
    )
    assert "RestartSecs" in done.stderr


@needs_analyze
@pytest.mark.parametrize(
    ("drop_ins", "limit"),
    [
        ((), EXPOSURE_LIMIT),
        (("gpio.conf",), EXPOSURE_LIMIT),
        (("network.conf",), NETWORK_EXPOSURE_LIMIT),
        (("network.conf", "gpio.conf"), NETWORK_EXPOSURE_LIMIT),
    ],
)
def test_the_service_is_not_more_exposed_than_it_was(
    installed_unit: Path, drop_ins: tuple[str, ...], limit: float
) -> None:
    with_drop_ins(installed_unit, drop_ins)
    command = ["systemd-analyze", "security", "--offline=true", "--no-pager", f"--threshold={round(10 * limit)}"]
    done = subprocess.run([*command, installed_unit], capture_output=True, text=True, check=False)
    print(done.stdout.strip().splitlines()[-1])
    assert done.returncode == 0, done.stdout


def test_no_boot_waits_for_a_chip_that_is_missing() -> None:
    """By default a target is not reached before all that it wants is ready, and this may take for ever."""
    unit = dict(directives())
    assert unit["Type"] == "notify" and unit["DefaultDependencies"] == "no"
    assert "--wait-for-device" in unit["ExecStart"]
    for order in ("Requires=sysinit.target", "Conflicts=shutdown.target", "Before=shutdown.target"):
        assert tuple(order.split("=")) in directives()


def test_no_directive_has_a_comment_behind_it() -> None:
    assert [(key, value) for key, value in directives() if "#" in value or ";" in value] == []


def test_a_program_that_gave_up_is_started_again_but_not_with_a_setting_that_cannot_be() -> None:
    unit = dict(directives())
    assert unit["Restart"] == "on-failure"
    assert unit["StartLimitIntervalSec"] == "0"
    assert unit["RestartPreventExitStatus"] == f"{exits.USAGE} {exits.SETTINGS}"


def test_the_real_time_settings_asked_for_by_default_are_allowed() -> None:
    unit, loop = dict(directives()), Settings().loop
    assert int(unit["LimitRTPRIO"]) >= loop.priority
    assert unit["LimitMEMLOCK"] == "infinity"
    assert ("DeviceAllow", f"{DMA_LATENCY_PATH} rw") in directives()
    rule = (FOLDER / "60-quavelet.rules").read_text()
    assert f'KERNEL=="{Path(DMA_LATENCY_PATH).name}"' in rule
    assert f'GROUP="{unit["SupplementaryGroups"]}"' in rule


def test_the_sample_configuration_has_every_key_at_its_default() -> None:
    path = FOLDER / "quavelet.toml"
    assert load_settings(path).settings == Settings()
    sample: dict[str, Any] = tomllib.loads(path.read_text())
    defaults: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(Settings()))
    assert sample == defaults


def test_the_sample_configuration_is_what_the_program_prints() -> None:
    assert (FOLDER / "quavelet.toml").read_text() == example(), "quavelet config --example > systemd/quavelet.toml"


def test_every_key_of_the_sample_configuration_stands_under_a_comment() -> None:
    lines = (FOLDER / "quavelet.toml").read_text().splitlines()
    assert [line for before, line in pairwise(lines) if "=" in line and line[0] != "#" and not before] == []


def test_every_file_the_readme_names_is_here_and_every_file_here_is_named() -> None:
    table = (FOLDER / "README.md").read_text().partition("\n## ")[0]
    named = {line.split("`")[1] for line in table.splitlines() if line.startswith("| `")}
    assert named == {path.name for path in FOLDER.iterdir()} - {"README.md"}
