"""Putting the service in place and taking it away again: a list of steps in words, made from what is there.

A step without anything to do only says so: a second installation finds everything in place, and a dry run is the same
list, not carried out.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import msgspec

from quavelet.service import gpio_on
from quavelet.service.drop_ins import DROP_INS, GPIO, needed, written_elsewhere
from quavelet.service.files import gone, holds, kept_of, put, take
from quavelet.service.gpio_on import gpio_advice
from quavelet.service.i2c_on import GROUP, i2c_advice
from quavelet.service.program import Program
from quavelet.service.steps import InstallError, Run, Step, run_command, write_file
from quavelet.settings import BusSettings, Settings, load_settings
from quavelet.settings.reference import example
from quavelet.settings.service import NAME

USER = "quavelet"
UNIT = "quavelet@.service"
RULE = "60-quavelet.rules"
PLACE = "/opt/quavelet/venv/bin/quavelet"
"""The program in the unit as it is shipped."""


def shipped(name: str) -> str:
    """The text of the unit or the udev rule: from the wheel, or from the source's folder."""
    inside = Path(__file__).parent / "systemd"
    folder = inside if inside.is_dir() else Path(__file__).parents[3] / "systemd"
    try:
        return (folder / name).read_text(encoding="utf-8")
    except OSError as error:
        raise InstallError(f"{folder / name} is missing ({error.strerror}): install quavelet anew") from error


@dataclass(frozen=True, slots=True)
class Installation:
    """The service `name` below `root`, which is / or a system that is prepared on another machine.

    live   whether systemd runs there, and is to be told
    """

    name: str
    program: Program
    root: Path = Path("/")
    live: bool = True
    run: Run = run_command

    def __post_init__(self) -> None:
        if not NAME.fullmatch(self.name):
            raise InstallError(f"{self.name!r} is no name of a service: letters, digits, _ and -, 32 at most")

    @property
    def config(self) -> Path:
        return self.root / "etc/quavelet" / f"{self.name}.toml"

    @property
    def service(self) -> str:
        return UNIT.replace("@", f"@{self.name}")

    @property
    def unit(self) -> Path:
        return self.root / "etc/systemd/system" / UNIT

    @property
    def rule(self) -> Path:
        return self.root / "etc/udev/rules.d" / RULE

    @property
    def drop_ins(self) -> Path:
        """The folder of what is this instance's only."""
        return self.root / "etc/systemd/system" / f"{self.service}.d"

    @property
    def recordings(self) -> Path:
        return self.root / "var/lib/quavelet"

    def install(self, *, chip: BusSettings | None = None, start: bool = True) -> list[Step]:
        """What is to be done, in order; the chip for new settings, None for that of those there, or else the default.

        Raises InstallError where the service could not run this program, SettingsError for settings that cannot be.
        """
        why_not = self.program.why_not()
        if why_not is not None:
            raise InstallError(why_not)
        there = load_settings(self.config if self.config.exists() else None).settings
        asked, chip = chip, there.bus if chip is None else chip
        unit = self._unit_text()
        sample = _with_value(example(), "name", msgspec.json.encode(chip.name).decode())
        sample = _with_value(sample, "address", f"0x{chip.address:02x}")
        return [
            self._group(GROUP, "the bus"),
            *self._user(),
            self._settings(sample, in_use=there.bus, asked=asked),
            put(self.unit, unit, "the unit; own changes belong into `systemctl edit`"),
            put(self.rule, shipped(RULE), "the udev rule that lets the group keep the processors awake"),
            *self._beyond(needed(there)),
            *self._told_udev(),
            *self._told_systemd(),
            self._enable(start),
            *self._to_do(chip.name, unit, there),
        ]

    def remove(self, *, purge: bool) -> list[Step]:
        """What is to be done, in order; what other instances use stays."""
        steps = []
        if self.unit.exists():
            how = ["disable", "--now"] if self.live else [*self._offline(), "disable"]
            steps.append(self._command("stop and disable the service", ["systemctl", *how, self.service]))
        steps += self._own_drop_ins_gone(purge)
        others = sorted({link.name for link in self.unit.parent.glob("*.wants/quavelet@*")} - {self.service})
        kept = [self.config, self.config.with_suffix(".toml.new"), *self._states()]
        if others:
            steps.append(Step(f"leave the unit, the udev rule and the user: {', '.join(others)} needs them"))
        else:
            ours = {self.unit: self._unit_text(), self.rule: shipped(RULE)}
            kept += [old for path in ours for old in kept_of(path)]
            steps += [gone(path) if purge else take(path, text) for path, text in ours.items()]
            steps += [*self._told_udev(), *self._told_systemd()]
        if not purge:
            there = [str(path) for path in (*kept, self.recordings) if path.exists()]
            if there:
                steps.append(Step(f"leave {', '.join(there)}: --purge takes them too"))
            return steps
        steps += [gone(path) for path in kept if path.exists()]
        if not others:
            steps.append(gone(self.recordings))
            if self._is_in("passwd", USER):
                steps.append(self._command("take away its user", ["userdel", *self._prefix(), USER]))
        calibrations = self.root / "etc/quavelet/calibration"
        if calibrations.exists():
            steps.append(Step(f"leave {calibrations}: a calibration is the chip's, not the service's"))
        return steps

    def _states(self) -> list[Path]:
        folders = (self.recordings, self.root / "run/quavelet")
        return sorted(path for folder in folders for path in folder.glob(f"{self.name}.state*"))

    def _unit_text(self) -> str:
        return shipped(UNIT).replace(PLACE, self.program.in_unit)

    def _group(self, group: str, what: str) -> Step:
        if self._is_in("group", group):
            return Step(f"the group {group} is there")
        return self._command(f"make the group that may use {what}", ["groupadd", *self._prefix(), "--system", group])

    def _user(self) -> list[Step]:
        if not self._is_in("passwd", USER):
            command = ["useradd", *self._prefix(), "--system", "--user-group", "--groups", GROUP, "--no-create-home"]
            command += ["--shell", "/usr/sbin/nologin", USER]
            return [self._command("make the user of the service, who may use the bus and not log in", command)]
        if USER in self._line("group", GROUP).rpartition(":")[2].split(","):
            return [Step(f"the user {USER} is there")]
        command = ["usermod", *self._prefix(), "--append", "--groups", GROUP, USER]
        return [self._command(f"let the user {USER} use the bus", command)]

    def _settings(self, sample: str, *, in_use: BusSettings, asked: BusSettings | None) -> Step:
        shown = self.config
        if not self.config.exists():
            return Step(
                f"write {shown}: the settings, to be changed as you like", lambda: write_file(self.config, sample)
            )
        if holds(self.config, sample):
            return Step(f"{shown} is there, as shipped")
        yours = f"leave {shown}, which is yours"
        if asked is not None and (asked.name, asked.address) != (in_use.name, in_use.address):
            yours += f" and has {in_use.name} at 0x{in_use.address:02x}, not {asked.name} at 0x{asked.address:02x}"
        beside = self.config.with_suffix(".toml.new")
        if beside.exists() and holds(beside, sample):
            return Step(f"{yours}; the sample lies beside it")
        return Step(f"{yours}; write the sample beside it, {beside.name}", lambda: write_file(beside, sample))

    def _beyond(self, wanted: dict[str, str]) -> list[Step]:
        """What lets it do more than the unit does, where its settings need that and only there."""
        steps = []
        for name in DROP_INS:
            path = self.drop_ins / name
            if name in wanted:
                steps += [self._group(gpio_on.GROUP, "GPIO lines")] if name == GPIO else []
                steps.append(put(path, shipped(name), wanted[name]))
            elif path.exists():
                steps += [Step(f"{path} is not needed by the settings any more"), take(path, shipped(name))]
        return steps

    def _own_drop_ins_gone(self, purge: bool) -> list[Step]:
        ours = {self.drop_ins / name: shipped(name) for name in DROP_INS if (self.drop_ins / name).exists()}
        olds = [old for name in DROP_INS for old in kept_of(self.drop_ins / name)] if purge else []
        steps = [gone(path) if purge else take(path, text) for path, text in ours.items()]
        steps += [gone(old) for old in olds]
        if self.drop_ins.is_dir():
            yours = sorted(path.name for path in set(self.drop_ins.iterdir()) - {*ours, *olds})
            if yours:
                steps.append(Step(f"leave {', '.join(yours)} in {self.drop_ins}: not of the installation"))
            elif purge:
                steps.append(Step(f"remove {self.drop_ins}", self.drop_ins.rmdir))
        return steps

    def _told_udev(self) -> list[Step]:
        if not self.live:
            return []
        later = "the rule holds from the next start of the machine on"
        return [
            self._command("tell udev", ["udevadm", "control", "--reload"], later),
            self._command("use the rule", ["udevadm", "trigger", "--sysname-match=cpu_dma_latency"], later),
        ]

    def _told_systemd(self) -> list[Step]:
        return [self._command("tell systemd", ["systemctl", "daemon-reload"])] if self.live else []

    def _enable(self, start: bool) -> Step:
        if self.live and start:
            command, words = (
                ["systemctl", "enable", "--now", "--no-block", self.service],
                "start the service, and at each start",
            )
            return self._command(f"{words} of the machine", command)
        command = ["systemctl", *self._offline(), "enable", self.service]
        return self._command("have the service started at the next start of the machine", command)

    def _to_do(self, bus: str, unit: str, settings: Settings) -> list[Step]:
        """What is left to a person."""
        todo, wanted = list[str](), needed(settings)
        if not (self.root / self.program.path.relative_to("/")).exists():
            todo.append(f"put the program where it is here, {self.program.path}, below {self.root}")
        if self.config.exists() and not self._user_reads(self.config):
            todo.append(
                f"sudo chgrp {USER} {self.config} && sudo chmod g+r {self.config}, which the service cannot read"
            )
        todo += [
            f"sudo systemctl edit {self.service}, and write [Service] and below it ReadWritePaths={folder}; the user "
            f"{USER} must be allowed to write there: the unit lets it write to /var/lib/quavelet only"
            for folder in written_elsewhere(settings)
        ]
        if self.live and self.unit.exists() and not self._runs_with(unit, wanted):
            todo.append(f"sudo systemctl restart {self.service}, which runs as before until then")
        kind, _, number = bus.partition(":")
        if kind == "linux" and number.isdecimal():
            todo += i2c_advice(int(number), root=self.root)
        todo += gpio_advice(self.program, root=self.root) if GPIO in wanted else []
        return [Step(f"to do: {what}") for what in todo]

    def _runs_with(self, unit: str, wanted: dict[str, str]) -> bool:
        """Whether unit and drop-ins are there as they are to be."""
        texts = {self.unit: unit} | {self.drop_ins / name: shipped(name) for name in wanted}
        there = {name for name in DROP_INS if (self.drop_ins / name).exists()}
        return there == set(wanted) and all(holds(path, text) for path, text in texts.items())

    def _user_reads(self, path: Path) -> bool:
        """Whether the service's user may read the file."""
        status = path.stat()
        user, group = (self._line("passwd", USER).split(":") + [""] * 4)[2:4]
        if user == str(status.st_uid):
            return bool(status.st_mode & 0o400)
        return bool(status.st_mode & (0o040 if group == str(status.st_gid) else 0o004))

    def _command(self, words: str, command: list[str], if_failed: str = "") -> Step:
        return Step(f"{words}: {' '.join(command)}", lambda: self.run(command), if_failed)

    def _prefix(self) -> list[str]:
        return [] if self.root == Path("/") else ["--prefix", str(self.root)]

    def _offline(self) -> list[str]:
        return [] if self.root == Path("/") else [f"--root={self.root}"]

    def _is_in(self, table: str, name: str) -> bool:
        return bool(self._line(table, name))

    def _line(self, table: str, name: str) -> str:
        """The line of /etc/passwd or /etc/group; "" where there is none."""
        try:
            lines = (self.root / "etc" / table).read_text(errors="replace").splitlines()
        except FileNotFoundError:
            return ""
        return next((line for line in lines if line.startswith(f"{name}:")), "")


def _with_value(sample: str, key: str, value: str) -> str:
    """The text with the first line of that key given this value."""
    return re.sub(rf"(?m)^{key} = .*", lambda _: f"{key} = {value}", sample, count=1)
