"""The help names every option of every command, and says what each is for."""

import pytest
import typer.main
from typer.testing import CliRunner

from quavelet.cli.app import app

TOP = typer.main.get_command(app).commands  # type: ignore[attr-defined]
COMMANDS = {**TOP, **{f"service {name}": command for name, command in TOP["service"].commands.items()}}


@pytest.mark.parametrize("name", list(COMMANDS))
def test_the_help_of_a_command_explains_each_option(name: str) -> None:
    shown = CliRunner().invoke(app, [*name.split(), "--help"], terminal_width=100)
    assert shown.exit_code == 0
    for parameter in COMMANDS[name].params:
        assert all(option in shown.output for option in parameter.opts)
        assert parameter.help, parameter.name
        assert parameter.help.split()[0] in shown.output
    assert COMMANDS[name].help


def test_the_commands_share_their_options() -> None:
    options = {name: {o for p in command.params for o in p.opts} for name, command in COMMANDS.items()}
    assert {"--bus", "--address", "--config"} <= options["run"] & options["doctor"] & options["config"]
    assert {"--json", "--duration", "--record", "--virtual-time"} <= options["run"] & options["demo"]
    assert {"--json", "--config", "--speed"} <= options["replay"]
