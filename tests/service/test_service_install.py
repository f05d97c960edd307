"""`quavelet service`: what it says, what it does, and what it leaves alone."""

from __future__ import annotations

import os
import re
import shutil
import stat
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest
from typer.testing import CliRunner

from quavelet.cli import exits
from quavelet.cli.app import app
from quavelet.core.errors import SettingsError
from quavelet.service.gpio_on import gpio_advice
from quavelet.service.i2c_on import i2c_advice
from quavelet.service.install import PLACE, UNIT, Installation, shipped
from quavelet.service.program import Program, this_program
from quavelet.service.steps import InstallError, Step, carry_out
from quavelet.settings import BusSettings, Settings, load_settings

PROGRAM = Program(Path("/usr/bin/env"))
FILES = {"etc/quavelet/imu0.toml", "etc/systemd/system/quavelet@.service", "etc/udev/rules.d/60-quavelet.rules"}


class Machine:
    """A system below a folder, and what would have been run on it."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.commands: list[str] = []
        self.said: list[str] = []
        (root / "etc").mkdir()
        self.accounts("root:x:0:0::/root:/bin/sh\n", "root:x:0:\n")

    def accounts(self, passwd: str, group: str) -> None:
        (self.root / "etc/passwd").write_text(passwd)
        (self.root / "etc/group").write_text(group)

    def run(self, command: Sequence[str]) -> None:
        self.commands.append(" ".join(command).replace(str(self.root), "ROOT"))
        if command[0] == "useradd":
            self.accounts("quavelet:x:999:999::/:/usr/sbin/nologin\n", "i2c:x:998:quavelet\nquavelet:x:999:\n")
        wants = self.root / "etc/systemd/system/multi-user.target.wants"
        if command[0] == "systemctl" and "enable" in command:
            wants.mkdir(parents=True, exist_ok=True)
            (wants / command[-1]).write_text("")
        if command[0] == "systemctl" and "disable" in command:
            (wants / command[-1]).unlink(missing_ok=True)

    def of(self, name: str, *, live: bool = False) -> Installation:
        return Installation(name, PROGRAM, self.root, live, self.run)

    def install(self, name: str = "imu0", *, chip: BusSettings | None = None, dry_run: bool = False) -> None:
        carry_out(self.of(name).install(chip=chip), say=self.said.append, dry_run=dry_run)

    def remove(self, name: str = "imu0", *, purge: bool = False) -> None:
        carry_out(self.of(name).remove(purge=purge), say=self.said.append, dry_run=False)

    @property
    def files(self) -> dict[str, str]:
        there = {str(path.relative_to(self.root)): path for path in self.root.rglob("*") if path.is_file()}
        return {name: path.read_text() for name, path in there.items() if name not in ("etc/passwd", "etc/group")}


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


def test_a_dry_run_says_the_same_and_does_nothing(machine: Machine) -> None:
    machine.install(dry_run=True)
    assert (machine.files, machine.commands) == ({}, [])
    dry, machine.said = machine.said, []
    machine.install()
    assert machine.said == dry
    wanted = {name for name in machine.files if ".wants/" not in name}
    assert wanted == FILES
    for name in FILES:
        assert any(name in words for words in dry), name
    for command in machine.commands:
        assert any(command.replace("ROOT", str(machine.root)) in words for words in dry), command


def test_what_is_installed_starts_this_program_with_settings_that_load(machine: Machine) -> None:
    machine.install(chip=BusSettings(name='odd:"\\1', address=0x69))
    unit = machine.files["etc/systemd/system/quavelet@.service"]
    assert "\nExecStart=/usr/bin/env run --config /etc/quavelet/%i.toml" in unit
    assert PLACE in shipped(UNIT)
    assert PLACE not in unit
    settings = load_settings(machine.root / "etc/quavelet/imu0.toml").settings
    assert settings == Settings(bus=BusSettings(name='odd:"\\1', address=0x69))


def test_others_can_read_what_is_written_whatever_the_umask_of_root(machine: Machine) -> None:
    before = os.umask(0o077)
    try:
        machine.install()
    finally:
        os.umask(before)
    for name in FILES:
        path = machine.root / name
        assert stat.S_IMODE(path.stat().st_mode) == 0o644
        assert stat.S_IMODE(path.parent.stat().st_mode) & 0o005 == 0o005


def test_a_second_installation_changes_nothing(machine: Machine) -> None:
    machine.install(chip=BusSettings(address=0x69))
    files, commands = machine.files, list(machine.commands)
    machine.install()
    assert machine.files == files
    assert machine.commands[len(commands) :] == [c for c in commands if c.startswith("systemctl")]


def test_settings_that_were_changed_are_never_overwritten(machine: Machine) -> None:
    machine.install()
    mine = machine.root / "etc/quavelet/imu0.toml"
    text = mine.read_text().replace("rate_hz = 100.0", "rate_hz = 50.0")
    mine.write_text(text)
    machine.install()
    assert mine.read_text() == text
    assert load_settings(mine.with_name("imu0.toml.new")).settings == Settings()
    assert any("imu0.toml.new" in words for words in machine.said)


def test_the_network_is_opened_only_for_outputs_that_need_it(machine: Machine) -> None:
    machine.install()
    config, opened = machine.root / "etc/quavelet/imu0.toml", "etc/systemd/system/quavelet@imu0.service.d/network.conf"
    config.write_text('[output.here]\nto = "unix:/run/quavelet/here.sock"\n')
    machine.install()
    assert opened not in machine.files
    for text in ('[output.a]\nto = "mqtt:broker"\n', '[service]\nmetrics = "127.0.0.1:9650"\n'):
        config.write_text(text)
        machine.install()
        assert machine.files[opened] == shipped("network.conf")
        machine.remove()
        assert opened not in machine.files


LINE = '[bus]\nint_line = "pinctrl-bcm2711:17"\n'
GPIO = "etc/systemd/system/quavelet@imu0.service.d/gpio.conf"


@pytest.mark.parametrize("text", ["", '[bus]\nname = "fake:tilt"\nint_line = "fake:int"\n'])
def test_pins_are_shut_where_no_line_is_asked_of_this_machine(machine: Machine, text: str) -> None:
    machine.install()
    (machine.root / "etc/quavelet/imu0.toml").write_text(text)
    machine.install()
    assert GPIO not in machine.files
    assert not any("gpio" in words for words in machine.commands + machine.said)


def test_a_data_ready_line_gets_its_group_and_its_device_and_remove_takes_them(machine: Machine) -> None:
    machine.install()
    (machine.root / "etc/quavelet/imu0.toml").write_text(LINE)
    machine.install("imu1")
    machine.said.clear()
    machine.commands.clear()
    machine.install(dry_run=True)
    assert (GPIO in machine.files, machine.commands) == (False, [])
    dry, machine.said = machine.said, []
    machine.install()
    assert machine.said == dry
    assert any("gpio.conf: the settings have a data-ready line at pinctrl-bcm2711" in words for words in dry)
    assert machine.files[GPIO] == shipped("gpio.conf")
    assert "groupadd --prefix ROOT --system gpio" in machine.commands
    assert "imu1.service.d" not in "".join(machine.files), "only where a line is configured"
    machine.remove()
    assert GPIO not in machine.files


def test_the_group_of_the_gpios_is_not_made_twice(machine: Machine) -> None:
    machine.install()
    machine.accounts((machine.root / "etc/passwd").read_text(), "i2c:x:998:quavelet\ngpio:x:986:\n")
    (machine.root / "etc/quavelet/imu0.toml").write_text(LINE)
    machine.install()
    assert "the group gpio is there" in machine.said
    assert not any("--system gpio" in command for command in machine.commands)


def test_what_the_settings_need_no_more_is_shut_again(machine: Machine) -> None:
    machine.install()
    config = machine.root / "etc/quavelet/imu0.toml"
    config.write_text(LINE + '[output.a]\nto = "udp:192.0.2.1:5555"\n')
    machine.install()
    folder = machine.root / GPIO
    assert {path.name for path in folder.parent.iterdir()} == {"gpio.conf", "network.conf"}
    config.write_text("")
    words = [step.words for step in machine.of("imu0", live=True).install()]
    assert any("systemctl restart" in word for word in words)
    machine.install()
    assert list(folder.parent.iterdir()) == []


def test_what_is_missing_for_a_line_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("quavelet.service.gpio_on.find_spec", lambda _: None)
    package, chip = gpio_advice(Program(Path("/opt/my venv/bin/quavelet")), root=tmp_path)
    assert "sudo '/opt/my venv/bin/pip' install 'quavelet[gpio]'" in package
    assert "there is no /dev/gpiochip*" in chip
    monkeypatch.setattr("quavelet.service.gpio_on.find_spec", lambda name: name)
    (tmp_path / "dev").mkdir()
    (tmp_path / "dev/gpiochip0").symlink_to("/dev/null")
    (shut,) = gpio_advice(PROGRAM, root=tmp_path)
    assert "/dev/gpiochip0 is not open to the group gpio: echo 'SUBSYSTEM==" in shut
    # What is no device is not asked whom it is open to.
    (tmp_path / "dev/gpiochip1").write_text("")
    assert gpio_advice(PROGRAM, root=tmp_path) == []


def test_a_unit_that_was_edited_is_replaced_and_kept(machine: Machine) -> None:
    machine.install()
    unit = machine.root / "etc/systemd/system/quavelet@.service"
    texts = []
    for edit in ("WatchdogSec=40", "WatchdogSec=50"):
        texts.append(unit.read_text().replace("WatchdogSec=30", edit))
        for _ in range(2):
            unit.write_text(texts[-1])
            machine.install()
            assert "WatchdogSec=30" in unit.read_text()
    # The same change kept twice is kept once.
    kept = sorted(unit.parent.glob("*.old*"))
    assert [path.read_text() for path in kept] == texts
    assert any(f"replace {unit}, which differs and is kept as {kept[1].name}" in words for words in machine.said)
    unit.write_text("mine")
    machine.remove()
    assert unit.with_name(f"{unit.name}.old3").read_text() == "mine"
    assert not unit.exists()
    machine.install()
    machine.remove(purge=True)
    assert machine.files == {}


def test_a_unit_that_was_masked_is_kept_as_the_link_it_is(machine: Machine) -> None:
    machine.install()
    unit = machine.root / "etc/systemd/system/quavelet@.service"
    unit.unlink()
    unit.symlink_to("/dev/null")
    machine.install()
    assert not unit.is_symlink()
    assert unit.with_name(f"{unit.name}.old").readlink() == Path("/dev/null")


def test_a_drop_in_of_yours_is_left_and_said(machine: Machine) -> None:
    machine.install()
    mine = machine.root / "etc/systemd/system/quavelet@imu0.service.d/override.conf"
    mine.parent.mkdir()
    mine.write_text("[Service]\n")
    machine.remove(purge=True)
    assert mine.exists()
    assert any("leave override.conf in" in words for words in machine.said)


def test_settings_that_the_service_cannot_read_are_told(machine: Machine) -> None:
    machine.install()
    config = machine.root / "etc/quavelet/imu0.toml"
    told = f"to do: sudo chgrp quavelet {config} && sudo chmod g+r {config}, which the service cannot read"
    assert told not in [step.words for step in machine.of("imu0").install()]
    config.chmod(0o640)
    assert told in [step.words for step in machine.of("imu0").install()]
    group = config.stat().st_gid
    machine.accounts(f"quavelet:x:999:{group}::/:/usr/sbin/nologin\n", f"i2c:x:998:quavelet\nquavelet:x:{group}:\n")
    assert told not in [step.words for step in machine.of("imu0").install()]
    config.chmod(0o600)
    assert told in [step.words for step in machine.of("imu0").install()]


def test_a_bus_given_for_settings_that_are_there_is_not_taken_silently(machine: Machine) -> None:
    machine.install()
    (machine.root / "etc/quavelet/imu0.toml").write_text('[bus]\nname = "linux:3"\n')
    machine.install(chip=BusSettings(name="linux:5", address=0x69))
    assert any("which is yours and has linux:3 at 0x68, not linux:5 at 0x69" in words for words in machine.said)


def test_settings_that_cannot_be_are_told_before_anything_is_done(machine: Machine) -> None:
    machine.install()
    (machine.root / "etc/quavelet/imu0.toml").write_text("[bus]\nadress = 1\n")
    done = len(machine.commands)
    with pytest.raises(SettingsError, match="adress"):
        machine.install()
    assert len(machine.commands) == done


def test_a_user_who_is_there_without_the_bus_is_given_it(machine: Machine) -> None:
    machine.accounts("quavelet:x:999:999::/:/usr/sbin/nologin\n", "i2c:x:998:pi\n")
    machine.install()
    assert machine.commands[0] == "usermod --prefix ROOT --append --groups i2c quavelet"


def test_removing_leaves_settings_and_recordings(machine: Machine) -> None:
    machine.install()
    recordings = machine.root / "var/lib/quavelet"
    recordings.mkdir(parents=True)
    (recordings / "imu0.state").write_text("state")
    (recordings / "a.qrec").write_text("recording")
    machine.remove()
    kept = {"etc/quavelet/imu0.toml", "var/lib/quavelet/imu0.state", "var/lib/quavelet/a.qrec"}
    assert set(machine.files) == kept
    assert any("imu0.toml" in words and "--purge" in words for words in machine.said)
    assert "systemctl --root=ROOT disable quavelet@imu0.service" in machine.commands
    assert not any(command.startswith("userdel") for command in machine.commands)


def test_a_purge_takes_all_but_the_calibrations(machine: Machine) -> None:
    machine.install()
    (machine.root / "var/lib/quavelet").mkdir(parents=True)
    (machine.root / "var/lib/quavelet/a.qrec").write_text("recording")
    calibration = machine.root / "etc/quavelet/calibration/chip.toml"
    calibration.parent.mkdir()
    calibration.write_text("")
    machine.remove(purge=True)
    assert set(machine.files) == {"etc/quavelet/calibration/chip.toml"}
    assert machine.commands[-1] == "userdel --prefix ROOT quavelet"


def test_removing_one_of_two_leaves_the_other_running(machine: Machine) -> None:
    machine.install("imu0")
    machine.install("imu1", chip=BusSettings(address=0x69))
    (machine.root / "var/lib/quavelet").mkdir(parents=True)
    for name in ("imu0.state", "imu1.state", "a.qrec"):
        (machine.root / "var/lib/quavelet" / name).write_text("")
    machine.remove("imu1", purge=True)
    names = set(machine.files)
    assert names >= FILES | {"var/lib/quavelet/imu0.state", "var/lib/quavelet/a.qrec"}
    assert not [name for name in names if "imu1" in name]
    assert not any(command.startswith("userdel") for command in machine.commands)


def test_removing_what_is_not_there_is_no_failure(machine: Machine) -> None:
    machine.remove(purge=True)
    assert (machine.files, machine.commands) == ({}, [])


def test_a_running_systemd_is_told_before_the_service_is_started(machine: Machine) -> None:
    words = [step.words for step in machine.of("imu0", live=True).install()]
    reload = next(k for k, word in enumerate(words) if "systemctl daemon-reload" in word)
    start = next(k for k, word in enumerate(words) if "systemctl enable --now --no-block quavelet@imu0.service" in word)
    assert reload < start
    assert max(k for k, word in enumerate(words) if word.startswith("write ")) < reload


def test_what_runs_as_before_after_an_update_is_told(machine: Machine) -> None:
    machine.install()
    unit = machine.root / "etc/systemd/system/quavelet@.service"
    unit.write_text(unit.read_text().replace("WatchdogSec=30", "WatchdogSec=40"))
    words = [step.words for step in machine.of("imu0", live=True).install()]
    assert "to do: sudo systemctl restart quavelet@imu0.service, which runs as before until then" in words
    assert f"replace {unit}, which differs" in " ".join(words)
    machine.install()
    words = [step.words for step in machine.of("imu0", live=True).install()]
    assert not any("restart" in word for word in words)


def test_a_card_without_the_program_is_told(machine: Machine) -> None:
    told = "to do: put the program where it is here, /usr/bin/env, below "
    assert any(step.words.startswith(told) for step in machine.of("imu0").install())
    (machine.root / "usr/bin").mkdir(parents=True)
    (machine.root / "usr/bin/env").write_text("")
    assert not any(step.words.startswith(told) for step in machine.of("imu0").install())


def test_a_machine_without_udev_gets_its_service_all_the_same(machine: Machine) -> None:
    def no_udev(command: Sequence[str]) -> None:
        if command[0] == "udevadm":
            raise InstallError("udevadm is not installed")
        machine.run(command)

    there = Installation("imu0", PROGRAM, machine.root, True, no_udev)
    carry_out(there.install(), say=machine.said.append, dry_run=False)
    assert machine.commands[-1] == "systemctl enable --now --no-block quavelet@imu0.service"
    assert any("not installed: the rule holds from" in words for words in machine.said)


def test_the_first_step_that_fails_is_the_last(machine: Machine) -> None:
    def refuses(command: Sequence[str]) -> None:
        raise InstallError(f"{command[0]}: no")

    there = Installation("imu0", PROGRAM, machine.root, False, refuses)
    with pytest.raises(InstallError, match="groupadd: no"):
        carry_out(there.install(), say=machine.said.append, dry_run=False)
    assert len(machine.said) == 1
    assert machine.files == {}


@pytest.mark.parametrize("name", ["", "../x", "a b", "x" * 33, "imu0.service", "%i", "ä", "a\nb", "a@b", "$(a)", "*"])
def test_a_name_that_could_lead_elsewhere_is_refused(machine: Machine, name: str) -> None:
    with pytest.raises(InstallError, match="is no name of a service"):
        machine.of(name)


@pytest.mark.parametrize(
    "path",
    [
        "/usr/no/such/quavelet",
        "/home/pi/venv/bin/quavelet",
        "/root/q/quavelet",
        "/tmp/q/quavelet",
        '/usr/a"b/quavelet',
        "/usr/a%b/quavelet",
        "/usr/a\nb/quavelet",
        "quavelet",
    ],
)
def test_a_program_that_the_service_does_not_see_is_refused_with_what_to_do(machine: Machine, path: str) -> None:
    there = Installation("imu0", Program(Path(path)), machine.root, False, machine.run)
    with pytest.raises(InstallError, match=r"sudo python3 -m venv /opt/quavelet/venv"):
        there.install()


def test_a_venv_whose_python_lies_in_a_home_is_refused() -> None:
    why_not = Program(Path("/usr/bin/env"), (Path("/home/pi/.local/share/uv/python3"),)).why_not()
    assert why_not is not None
    assert why_not.startswith("/home/pi/.local/share/uv/python3 lies in /home")


def test_a_program_in_a_folder_with_spaces_stands_in_quotes(
    machine: Machine, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("quavelet.service.program.HIDDEN", ())
    monkeypatch.setattr("quavelet.service.program._shut", lambda _: None)
    program = tmp_path / "my venv/bin/quavelet"
    there = Installation("imu0", Program(program), machine.root, False, machine.run)
    carry_out(there.install(), say=machine.said.append, dry_run=False)
    unit = machine.files["etc/systemd/system/quavelet@.service"]
    assert f'\nExecStart="{program}" run --config /etc/quavelet/%i.toml' in unit


def test_a_folder_that_others_may_not_enter_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("quavelet.service.program.HIDDEN", ())
    (tmp_path / "quavelet").write_text("")
    tmp_path.chmod(0o700)
    why_not = Program(tmp_path / "quavelet").why_not()
    assert why_not is not None
    # pytest's own folders above it are shut, too.
    assert re.match(r"\S+ is not there, or shut to the service's user: put it where every user can read it", why_not)


def test_the_program_found_is_one_that_can_be_run() -> None:
    program = this_program()
    assert program.path.is_absolute()
    assert program.path.name == "quavelet"
    assert all(part.exists() for part in program.parts[1:])


@pytest.mark.parametrize(
    ("lines", "device", "told"),
    [
        (None, True, []),
        (None, False, ["modprobe i2c-dev"]),
        ("#dtparam=i2c_arm=on\n", False, ["raspi-config nonint do_i2c 0"]),
        ("dtparam=i2c_arm=off\n", False, ["raspi-config nonint do_i2c 0"]),
        ("dtparam=audio=on,i2c_arm=on\n", False, ["modprobe i2c-dev"]),
        ("dtparam=i2c_arm=on\n", True, ["i2c_arm_baudrate=400000"]),
        ("dtparam=i2c_arm=on,i2c_arm_baudrate=400000\n", True, []),
        ("dtparam=i2c_arm=on\ndtparam=i2c_arm_baudrate=fast\n", True, ["i2c_arm_baudrate=400000"]),
    ],
)
def test_a_bus_that_is_off_or_slow_is_told_with_what_to_do(
    tmp_path: Path, lines: str | None, device: bool, told: list[str]
) -> None:
    (tmp_path / "dev").mkdir()
    if device:
        (tmp_path / "dev/i2c-1").write_text("")
    if lines is not None:
        (tmp_path / "boot/firmware").mkdir(parents=True)
        (tmp_path / "boot/firmware/config.txt").write_text(f"[all]\n{lines}")
    advice = i2c_advice(1, root=tmp_path)
    assert len(advice) == len(told)
    for sentence, words in zip(advice, told, strict=True):
        assert words in sentence


def test_the_bus_of_settings_that_are_there_is_looked_at(machine: Machine) -> None:
    machine.install(chip=BusSettings(name="linux:7"))
    machine.said.clear()
    machine.install()
    assert [words for words in machine.said if words.startswith("to do: there is no /dev/i2c-7")]
    machine.install(chip=BusSettings(name="fake:tilt"))
    assert "/dev/i2c" not in machine.said[-1]


def test_without_root_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr("quavelet.cli.service.this_program", lambda: PROGRAM)
    result = CliRunner().invoke(app, ["service", "remove"])
    assert isinstance(result.exception, InstallError)
    assert str(result.exception).startswith("this needs root: sudo /usr/bin/env service remove")
    assert exits.exit_code(result.exception) == exits.FAILED
    assert CliRunner().invoke(app, ["service", "remove", "--dry-run"]).exit_code == exits.OK


def test_that_it_needs_root_is_said_first_and_with_the_same_options(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is wrong besides may be wrong only for one who may not look."""
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr("quavelet.cli.service.this_program", lambda: Program(Path("/home/me/my venv/bin/quavelet")))
    result = CliRunner().invoke(app, ["service", "install", "--name", "a b", "--bus", "linux:3"])
    assert str(result.exception) == (
        "this needs root: sudo '/home/me/my venv/bin/quavelet' service install --name 'a b' --bus linux:3, "
        "or --dry-run to see each step"
    )


def test_a_dry_run_that_may_not_look_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def shut(self: Installation, **_: object) -> list[Step]:
        return [Step((self.root / "etc/quavelet/imu0.toml").read_text())]

    monkeypatch.setattr(Installation, "install", shut)
    (tmp_path / "etc").write_text("no folder")
    result = CliRunner().invoke(app, ["service", "install", "--dry-run", "--root", str(tmp_path)])
    assert isinstance(result.exception, InstallError)
    assert str(result.exception) == f"{tmp_path}/etc/quavelet/imu0.toml: Not a directory: move it away first"


@pytest.mark.skipif(os.geteuid() != 0 or not shutil.which("useradd"), reason="only root may make users, by useradd")
def test_the_real_commands_work_below_another_root(tmp_path: Path) -> None:
    (tmp_path / "etc").mkdir()
    for name, text in (("passwd", "root:x:0:0::/root:/bin/sh\n"), ("group", "root:x:0:\n")):
        (tmp_path / "etc" / name).write_text(text)
    there = Installation("imu0", PROGRAM, tmp_path, False)
    carry_out(there.install(), say=print, dry_run=False)
    assert "i2c:" in (tmp_path / "etc/group").read_text()
    assert "quavelet:" in (tmp_path / "etc/passwd").read_text()
    assert [path.name for path in tmp_path.glob("etc/systemd/system/*.wants/*")] == ["quavelet@imu0.service"]
    assert [step.words for step in there.install()][:2] == ["the group i2c is there", "the user quavelet is there"]
    carry_out(there.remove(purge=True), say=print, dry_run=False)
    assert "quavelet" not in (tmp_path / "etc/passwd").read_text()
    assert not [path for path in tmp_path.rglob("quavelet*") if path.is_file()]
    assert subprocess.run(["id", "quavelet"], capture_output=True, check=False).returncode != 0


@pytest.mark.parametrize(
    ("text", "folder"),
    [
        ('[recording]\ndirectory = "/mnt/usb/quavelet"\n', "/mnt/usb/quavelet"),
        ('[web]\nrecordings = "/srv/boards"\n', "/srv/boards"),
        ('[output.own]\nto = "unix:/srv/sockets/board.sock"\n', "/srv/sockets"),
    ],
)
def test_a_folder_that_the_unit_does_not_let_it_write_to_is_told(machine: Machine, text: str, folder: str) -> None:
    machine.install()
    (machine.root / "etc/quavelet/imu0.toml").write_text(text)
    (told,) = [step.words for step in machine.of("imu0").install() if "ReadWritePaths" in step.words]
    assert f"ReadWritePaths={folder};" in told
    (machine.root / "etc/quavelet/imu0.toml").write_text('[recording]\ndirectory = "/var/lib/quavelet/all"\n')
    assert not [step for step in machine.of("imu0").install() if "ReadWritePaths" in step.words]
