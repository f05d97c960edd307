"""The rolling check of the chip's registers: a supply that dips for a moment changes them without a word."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from enum import Enum

from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.registers import RegisterBits

CHECK_NS = 50 * NS_PER_MS
"""A check is two short bursts: by turns that of rate, filters and ranges, and that of FIFO and power, each thus every
100 ms; and one of the others, every 150 ms."""
_FIRST = (r.SMPLRT_DIV.address, r.USER_CTRL.address)

Run = tuple[RegisterBits, ...]
"""Rows of registers that follow one another."""

log = logging.getLogger(__name__)


class Finding(Enum):
    """What a check of the registers came to."""

    GOOD = "all as written"
    REWRITTEN = "one had changed and was written anew"
    RESET = "the chip must be reset"


class RegisterWatch:
    """Compares the registers with what was written. Every method raises BusError."""

    def __init__(
        self,
        chip: RegisterAccess,
        table: Iterable[RegisterBits],
        *,
        who_am_i: int,
        since_ns: int,
        health: Health,
        slaves: int = 0,
    ) -> None:
        """`table` is the configuration, which held at `since_ns`; the running FIFO, with the bytes of so many `slaves`,
        is added to it."""
        self._chip = chip
        self._health = health
        frames = r.fifo_en(slaves)
        running = (
            RegisterBits(r.USER_CTRL, r.USER_FIFO_EN.mask, 0),
            RegisterBits(r.FIFO_EN, frames, ~frames & 0xFF),
            RegisterBits(r.WHO_AM_I, who_am_i, ~who_am_i & 0xFF),
        )
        runs = _runs(r.joined((*table, *running)))
        self._first = [run for run in runs if run[0].register.address in _FIRST]
        self._others = [run for run in runs if run[0].register.address not in _FIRST]
        self._turn = 0
        self._due_ns = since_ns + CHECK_NS

    def due(self, now_ns: int) -> bool:
        return now_ns >= self._due_ns

    def check_some(self, now_ns: int) -> Finding:
        """The registers whose turn it is, and all the others where one of them has changed."""
        self._due_ns = now_ns + CHECK_NS
        runs = (self._first[self._turn % len(self._first)], self._others[self._turn % len(self._others)])
        self._turn += 1
        return self.check_all() if any(self._changed(run) for run in runs) else Finding.GOOD

    def check_all(self) -> Finding:
        """Every register; one that has changed is written anew, of more than one the chip has lost its setting."""
        changed = [row for run in (*self._first, *self._others) for row in self._changed(run)]
        if not changed:
            return Finding.GOOD
        names = ", ".join(row.register.name for row in changed)
        log.warning("the chip at 0x%02x has changed by itself: %s", self._chip.address, names)
        self._health.registers_upset += len(changed)
        row = changed[0]
        if len(changed) > 1 or row.register in (r.PWR_MGMT_1, r.WHO_AM_I):
            return Finding.RESET
        self._chip.apply(row)
        return Finding.REWRITTEN if row.holds(self._chip.read(row.register)) else Finding.RESET

    def _changed(self, run: Run) -> list[RegisterBits]:
        """The rows of this run that do not hold, looked at twice: the first look may have been disturbed."""
        return self._unlike(run) and self._unlike(run)

    def _unlike(self, run: Run) -> list[RegisterBits]:
        read = self._chip.read_run(run[0].register, len(run))
        return [row for row, byte in zip(run, read, strict=True) if not row.holds(byte)]


def _runs(rows: Iterable[RegisterBits]) -> list[Run]:
    """The rows in the order of their addresses, those that follow one another together: each can be read in one go."""
    runs: list[list[RegisterBits]] = []
    for row in sorted(rows, key=lambda row: row.register.address):
        if runs and row.register.address == runs[-1][-1].register.address + 1:
            runs[-1].append(row)
        else:
            runs.append([row])
    return [tuple(run) for run in runs]
