"""`python -m hw_fakes`: serve a fake MPU-6050 to any program, tell it what to do meanwhile, list what there is."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from contextlib import ExitStack

from hw_fakes.boards import BOARDS, Board
from hw_fakes.chip.personalities import PERSONALITIES
from hw_fakes.faults.plan import KINDS, own_keys
from hw_fakes.scenarios import ADDRESS, COUNTS, MOTIONS, RECORDED
from hw_fakes.serve import control
from hw_fakes.serve.serving import Making, attach, new_chip, planned, run_with_usbip
from hw_fakes.ways.preload import run_with_device
from hw_fakes.wire.adapter import Adapter
from quavelet.core.clock import MonotonicClock
from quavelet.core.errors import SettingsError

TOOL_FAILED = 125  # beside 126 and 127, as env(1) and timeout(1) have it: every other code is the program's
INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """The exit code: the program's, or 2 for a command that is none, 125 where the fake cannot be had."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    end = arguments.index("--") if "--" in arguments else len(arguments)
    parser, program = _parser(), arguments[end + 1 :]
    asked = parser.parse_args(arguments[:end])
    try:
        if asked.command == "list":
            return _list()
        if asked.command == "control":
            return control.send(asked.path, [" ".join(asked.words)] if asked.words else sys.stdin)
        return _serve(parser, asked, program)
    except (SettingsError, ValueError) as error:
        print(f"hw_fakes: {error}", file=sys.stderr)
        return TOOL_FAILED
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is still in the buffer goes nowhere
        return INTERRUPTED


def _serve(parser: argparse.ArgumentParser, asked: argparse.Namespace, program: Sequence[str]) -> int:
    chips: list[tuple[int, str]] = [(asked.address, asked.scenario)] if asked.scenario else []
    chips += asked.chip
    if not chips:
        parser.error("there is no chip to serve: write --scenario NAME, or --chip ADDRESS=NAME")
    if not program and asked.way == "i2c-dev":
        parser.error("there is no program to run: write it after --, as in `serve --scenario tilt -- i2cdetect -y 1`")
    if asked.bus is not None and asked.way == "usbip":
        parser.error("the kernel gives the number of its adapter: leave --bus out")
    if asked.board is not None and len(chips) > 1:
        parser.error("two boards have a magnetometer at one address: leave --board or --chip out")
    faults = planned(asked.faults, asked.fault_file)
    clock = MonotonicClock()
    adapter = Adapter(clock=clock, speed_hz=asked.speed or 400_000, paced=asked.speed is not None)
    for i, (address, which) in enumerate(chips):
        making = Making(
            perfect=asked.perfect,
            seed=None if asked.seed is None else asked.seed + i,
            rate_error=asked.rate_error,
            personality=asked.personality,
            board=asked.board,
        )
        attach(adapter, address, new_chip(which, clock=clock, making=making))
    for entry in faults:
        adapter.faults.add(entry)
    with ExitStack() as stack:
        if asked.control is not None:
            stack.enter_context(control.control_socket(asked.control, adapter))
        if asked.way == "usbip":
            return run_with_usbip(program, adapter=adapter)
        return run_with_device(program, adapter=adapter, bus=1 if asked.bus is None else asked.bus)


def _list() -> int:
    rows = [("scenario", name, type(motion).__doc__ or "") for name, motion in MOTIONS.items()]
    rows += [
        ("scenario", f"{RECORDED}FILE.npz", "A recording of motion, with the attitude measured beside it."),
        ("scenario", f"{COUNTS}FILE.npz", "Recorded register counts, byte for byte."),
    ]
    rows += [("personality", chip.name, f"WHO_AM_I 0x{chip.who_am_i:02x}") for chip in PERSONALITIES]
    rows += [("board", name, _parts(product)) for name, product in BOARDS.items()]
    rows += [
        ("fault", " ".join([name, *(f"{key}=" for key in own_keys(kind))]), kind.does()) for name, kind in KINDS.items()
    ]
    for group, name, text in rows:
        print(f"{group:<12} {name:<28} {text.partition(chr(10))[0].replace('`', '')}")
    return 0


def _parts(board: Board) -> str:
    magnetometer = f" with a magnetometer {board.magnetometer.__name__.upper()}" if board.magnetometer else ""
    return f"{board.personality.name}{magnetometer}"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m hw_fakes", description="A fake MPU-6050 for any program.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", dest="command")
    serve = commands.add_parser(
        "serve",
        help="run a program with the fake as its I2C device",
        usage="%(prog)s --scenario NAME [options] [-- PROGRAM [ARGUMENT ...]]",
        epilog="The exit code is the program's; 125 where the fake cannot be had.",
    )
    serve.add_argument("--scenario", metavar="NAME", help="what the board does: a NAME of fake:NAME, as tilt or still")
    serve.add_argument("--address", type=number, default=ADDRESS, help="of the chip, 0x68 or 0x69 (0x68)")
    serve.add_argument(
        "--chip", type=chip_at, action="append", default=[], metavar="ADDRESS=NAME", help="one more; may come again"
    )
    kind = serve.add_mutually_exclusive_group()
    kind.add_argument("--personality", metavar="NAME", help="which chip of the family, as MPU-6500 (MPU-6050)")
    kind.add_argument("--board", metavar="NAME", help="which board, with its magnetometer behind the chip, as gy-87")
    serve.add_argument("--perfect", action="store_true", help="no noise, no bias, no error of the oscillator")
    serve.add_argument("--seed", type=number, metavar="N", help="another board, drawn from the data sheet's limits")
    serve.add_argument("--rate-error", type=float, metavar="X", help="of the oscillator: 0.01 is 1 %% too fast")
    serve.add_argument(
        "--faults", action="append", default=[], metavar="TEXT", help="as 'nack every=10 for=0.5'; may come again"
    )
    serve.add_argument("--fault-file", metavar="FILE", help="faults, one a line")
    serve.add_argument(
        "--speed", type=speed, metavar="HZ", help="of the wires: a transfer takes its time, as at 100000"
    )
    serve.add_argument(
        "--as",
        dest="way",
        choices=["i2c-dev", "usbip"],
        default="i2c-dev",
        help="i2c-dev: /dev/i2c-N of the program, by LD_PRELOAD; usbip: of the whole machine, by its kernel, as root",
    )
    serve.add_argument("--bus", type=bus_number, metavar="N", help="the N of /dev/i2c-N, with i2c-dev (1)")
    serve.add_argument("--control", metavar="PATH", help="a socket that takes lines meanwhile; see the command control")
    send = commands.add_parser(
        "control", help="tell a served fake what to do", epilog="Exit code 1 where an answer is an error."
    )
    send.add_argument("path", metavar="PATH", help="that of --control")
    send.add_argument("words", nargs="*", metavar="WORD", help="one line, as `motion walk`; without, those of stdin")
    commands.add_parser("list", help="scenarios, personalities and faults")
    return parser


def number(text: str) -> int:
    return int(text, 0)


def bus_number(text: str) -> int:
    number = int(text)
    if not 0 <= number <= 255:
        raise ValueError
    return number


def speed(text: str) -> int:
    number = int(text)
    if not 1_000 <= number <= 5_000_000:
        raise argparse.ArgumentTypeError(f"{text} Hz is no speed of I2C wires: take 100000 or 400000")
    return number


def chip_at(text: str) -> tuple[int, str]:
    address, equals, name = text.partition("=")
    try:
        if equals and name:
            return int(address, 0), name
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"'{text}' is no chip at an address: write one as 0x69=walk")


if __name__ == "__main__":
    sys.exit(main())
