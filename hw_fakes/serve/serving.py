"""The worlds of `python -m hw_fakes serve`: chips by name on an adapter, and programs run with it."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from hw_fakes.boards import board
from hw_fakes.chip.counts import RecordedCounts
from hw_fakes.chip.mpu6050 import FakeMpu6050
from hw_fakes.chip.personalities import MPU6050, PERSONALITIES, Personality
from hw_fakes.faults.plan import FaultEntry, parse, parse_lines
from hw_fakes.scenarios import COUNTS, SEED, check_name, counts_chip, motion_named
from hw_fakes.ways.preload import run_program
from hw_fakes.ways.usb_ip import attached_usbip
from hw_fakes.wire.adapter import Adapter
from hw_fakes.world.imperfections import PERFECT, TYPICAL, draw
from hw_fakes.world.motion_switched import SwitchedMotion
from quavelet.core.clock import Clock
from quavelet.core.errors import SettingsError

PLL_ERROR, INTERNAL_ERROR = 0.007, -0.03  # as FakeMpu6050 has them
MOST_RATE_ERROR = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Making:
    """How chips are made; None: as a bought one.

    perfect      no noise, no bias, no error of the oscillators
    seed         a board drawn from the data sheet's limits by this number, in place of a typical one
    rate_error   how much too fast both oscillators are: 0.01 is 1 % more samples a second
    personality  which chip of the family, by its name
    board        which board, by its name in `BOARDS`: it says which chip, and has a magnetometer
    """

    perfect: bool = False
    seed: int | None = None
    rate_error: float | None = None
    personality: str | None = None
    board: str | None = None

    def __post_init__(self) -> None:
        if self.rate_error is not None and not abs(self.rate_error) <= MOST_RATE_ERROR:
            raise SettingsError(
                f"a rate error of {self.rate_error} is none of a chip: take one up to {MOST_RATE_ERROR}"
            )
        if self.seed is not None and self.seed < 0:
            raise SettingsError(f"seed {self.seed} is below 0: take 0 or more")


def new_chip(which: str, *, clock: Clock, making: Making) -> FakeMpu6050:
    """A chip of the world `fake:WHICH`, whose motion is a `SwitchedMotion`. Raises SettingsError."""
    check_name(which)
    if which.startswith(COUNTS):
        if making != Making():
            raise SettingsError(
                "recorded counts are as they are: leave out --perfect, --seed, --rate-error, --personality and --board"
            )
        return counts_chip(RecordedCounts.load(which.removeprefix(COUNTS)), clock=clock)
    pll_error, internal_error = (0.0, 0.0) if making.perfect else (PLL_ERROR, INTERNAL_ERROR)
    if making.rate_error is not None:
        pll_error = internal_error = making.rate_error
    motion = SwitchedMotion(motion_named(which))
    product = None if making.board is None else board(making.board)
    drawn = TYPICAL if making.seed is None else draw(making.seed)
    return FakeMpu6050(
        clock,
        motion=motion,
        imperfections=PERFECT if making.perfect else drawn,
        pll_error=pll_error,
        internal_error=internal_error,
        seed=SEED if making.seed is None else making.seed,
        personality=product.personality if product else personality_named(making.personality),
        aux=product.aux_master(clock, motion) if product else None,
    )


def attach(adapter: Adapter, address: int, chip: FakeMpu6050) -> None:
    """Put a chip on the wires, and behind its bypass what its board has on the auxiliary bus. Raises ValueError."""
    adapter.attach(address, chip)
    for at, target in (chip.aux.outside() if chip.aux else {}).items():
        adapter.attach(at, target)


def personality_named(name: str | None) -> Personality:
    """The chip of the family with this name; None: the MPU-6050. Raises SettingsError."""
    for personality in PERSONALITIES:
        if personality.name == (name or MPU6050.name):
            return personality
    known = ", ".join(personality.name for personality in PERSONALITIES)
    raise SettingsError(f"there is no personality '{name}': take one of {known}")


def planned(texts: Iterable[str], path: str | None) -> list[FaultEntry]:
    """The entries of `--faults` and of a file. Raises SettingsError."""
    entries = [parse(text) for text in texts]
    if path is not None:
        try:
            entries += parse_lines(Path(path).read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError) as error:
            raise SettingsError(f"the faults in {path} cannot be read ({error}): give another file") from None
    return entries


def run_with_usbip(program: Sequence[str], *, adapter: Adapter) -> int:
    """Plug `adapter` into the running kernel and run `program`, or wait for SIGINT or SIGTERM; the exit code.

    The program finds the N of /dev/i2c-N in HW_FAKES_I2C_BUS; without one, N is on stdout. Raises SettingsError.
    """
    with attached_usbip(adapter) as number:
        if program:
            return run_program(program, {"HW_FAKES_I2C_BUS": str(number)})
        ended = threading.Event()
        before = {sign: signal.signal(sign, lambda *_: ended.set()) for sign in (signal.SIGINT, signal.SIGTERM)}
        try:
            print(f"hw_fakes: the fake is /dev/i2c-{number}; Ctrl-C, or SIGTERM, takes it away", file=sys.stderr)
            print(number, flush=True)
            ended.wait()
        finally:
            for sign, handler in before.items():
                signal.signal(sign, handler)
    return 0
