"""`python -m hw_fakes serve`: any program with a fake MPU-6050 as its /dev/i2c-N."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from hw_fakes.chip import FakeMpu6050
from hw_fakes.i2c_adapter import Adapter
from hw_fakes.imperfections import PERFECT
from hw_fakes.preload import run_with_device
from hw_fakes.scenarios import ADDRESS, open_fake
from quavelet.core.clock import MonotonicClock
from quavelet.core.errors import SettingsError

TOOL_FAILED = 125  # beside 126 and 127, as env(1) and timeout(1) have it: every other code is the program's


def main(arguments: Sequence[str] | None = None) -> int:
    """The exit code: the program's, or 2 for a command that is none, 125 where the fake cannot be had."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    end = arguments.index("--") if "--" in arguments else len(arguments)
    parser, program = _parser(), arguments[end + 1 :]
    asked = parser.parse_args(arguments[:end])
    if not program:
        parser.error("there is no program to run: write it after --, as in `serve --scenario tilt -- i2cdetect -y 1`")
    try:
        adapter = Adapter({asked.address: _chip(asked.scenario, perfect=asked.perfect)})
        return run_with_device(program, adapter=adapter, bus=asked.bus)
    except (SettingsError, ValueError) as error:
        print(f"hw_fakes: {error}", file=sys.stderr)
        return TOOL_FAILED


def _chip(scenario: str, *, perfect: bool) -> FakeMpu6050:
    clock = MonotonicClock()
    chip = open_fake(scenario, clock=clock).targets[ADDRESS]
    assert isinstance(chip, FakeMpu6050)
    if not perfect:
        return chip
    if chip.motion is None:
        raise SettingsError("recorded counts are what they are: leave --perfect out")
    return FakeMpu6050(clock, motion=chip.motion, imperfections=PERFECT, pll_error=0.0, internal_error=0.0)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m hw_fakes", description="A fake MPU-6050 for any program.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    serve = commands.add_parser(
        "serve",
        help="run a program with the fake as its I2C device",
        usage="%(prog)s --scenario NAME [options] -- PROGRAM [ARGUMENT ...]",
        epilog="The exit code is the program's; 125 where the fake cannot be had.",
    )
    serve.add_argument("--scenario", required=True, help="what the board does: a NAME of fake:NAME, as tilt or still")
    serve.add_argument("--as", choices=["i2c-dev"], default="i2c-dev", help="i2c-dev: as /dev/i2c-N, by LD_PRELOAD")
    serve.add_argument("--bus", type=bus_number, default=1, metavar="N", help="the N of /dev/i2c-N (1)")
    serve.add_argument("--address", type=number, default=ADDRESS, help="of the chip, 0x68 or 0x69 (0x68)")
    serve.add_argument("--perfect", action="store_true", help="no noise, no bias, no error of the oscillator")
    return parser


def number(text: str) -> int:
    return int(text, 0)


def bus_number(text: str) -> int:
    number = int(text)
    if not 0 <= number <= 255:
        raise ValueError
    return number


if __name__ == "__main__":
    sys.exit(main())
