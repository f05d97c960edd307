"""Faults on an adapter: by a plan or by hand, with the history of what really happened."""

from __future__ import annotations

import heapq
import os
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from random import Random
from typing import TYPE_CHECKING

from hw_fakes.chip.mpu6050 import FakeMpu6050
from hw_fakes.faults.base import Fault, Happened, Touch, registers_from
from hw_fakes.faults.of_chip import ChipFault, Site, seen_at
from hw_fakes.faults.of_wires import WireFault
from hw_fakes.faults.plan import FaultEntry
from hw_fakes.target import Target
from quavelet.core.clock import Clock
from quavelet.core.units import NS_PER_S

if TYPE_CHECKING:
    from hw_fakes.wire.adapter import Adapter

KEPT = 100_000


@dataclass(slots=True, eq=False)
class _Active:
    """An entry that acts on transfers until a time, or so many of them."""

    entry: FaultEntry
    kind: WireFault
    rng: Random
    until_ns: int | None
    left: int | None
    touched: bool = False


@dataclass(slots=True, eq=False)
class _Lasting:
    """A fault of a chip that is not over."""

    kind: Fault
    address: int
    undo: Callable[[], None]


class Faults:
    """The faults of one adapter; every way into the fake has them.

    Time is that of the adapter's clock, 0 where the adapter was made. A plan is followed with the transfers: a fault of
    the chip that was due since the last one happens first, at its own time. Who looks at the chip in another way, as at
    its INT pin, calls `catch_up` before. The same plan, seeds and transactions give the same faults.

    busy     whether there is any entry, or any fault that is not over
    history  what happened, the oldest first; of very many the newest 100 000
    """

    def __init__(self, adapter: Adapter, *, clock: Clock) -> None:
        self.busy = False
        self.history: deque[Happened] = deque(maxlen=KEPT)
        self._adapter = adapter
        self._clock = clock
        self._birth_ns = clock.now_ns()
        self._plan: list[FaultEntry] = []
        self._added = 0
        self._agenda: list[tuple[int, int, Callable[[int], None]]] = []
        self._on_agenda = 0
        self._drawn: list[tuple[FaultEntry, Random, int]] = []
        self._waiting: list[tuple[FaultEntry, ChipFault, Random, int]] = []
        self._active: list[_Active] = []
        self._lasting: list[_Lasting] = []
        self._in_transfer = False
        self._transfer_ns = 0
        self._held_ns = 0
        self._address = 0
        self._pointers: dict[int, int | None] = {}

    @property
    def plan(self) -> tuple[FaultEntry, ...]:
        """The entries that are to come, or to come again."""
        return tuple(self._plan)

    @property
    def lasting(self) -> tuple[tuple[Fault, int], ...]:
        """The faults of chips that are not over, with the chip's address."""
        return tuple((one.kind, one.address) for one in self._lasting)

    def time_s(self, t_ns: int | None = None) -> float:
        """Time of the fake world at clock time `t_ns`, or now."""
        return ((self._clock.now_ns() if t_ns is None else t_ns) - self._birth_ns) / NS_PER_S

    def add(self, entry: FaultEntry) -> None:
        """Add an entry to the plan.

        Raises ValueError where its time was past already when the last transfer was made, or the chip it means is not
        there.
        """
        now_ns = self._clock.now_ns()
        self.check_there(entry)
        from_ns = now_ns if entry.at_s is None else self._birth_ns + round(entry.at_s * NS_PER_S)
        if from_ns < now_ns and self._adapter.transfers:
            raise ValueError(f"{entry} is past, it is {self.time_s(now_ns):.3f} s: give a later at, or leave it out")
        rng = Random(f"{entry.seed} {self._added}")
        self._added += 1
        self._plan.append(entry)
        if entry.p is not None:
            self._drawn.append((entry, rng, from_ns))
        elif entry.per_minute is not None:
            self._later(from_ns + _gap_ns(entry.per_minute, rng), partial(self._again, entry, rng))
        elif entry.every_s is not None:
            first_ns = from_ns + (0 if entry.at_s is not None else round(entry.every_s * NS_PER_S))
            self._later(first_ns, partial(self._again, entry, rng))
        else:
            self._later(from_ns, partial(self._once, entry, rng))
        self.catch_up()

    def check_there(self, entry: FaultEntry) -> None:
        """Raises ValueError where the chip that an entry means is not there."""
        if isinstance(entry.kind, ChipFault) and not self._chips(entry.address):
            where = "on these wires" if entry.address is None else f"at 0x{entry.address:02x}"
            raise ValueError(f"there is no MPU-6050 {where} for {entry}: give the address of one")

    def is_over(self, entry: FaultEntry) -> bool:
        """Whether this very entry neither is to come nor acts nor lasts."""
        entries = (*self._plan, *(it.entry for it in self._active), *(it[0] for it in self._waiting))
        return all(it is not entry for it in entries) and all(it.kind is not entry.kind for it in self._lasting)

    def now(
        self,
        kind: Fault,
        *,
        for_s: float | None = None,
        n: int | None = None,
        address: int | None = None,
        seed: int = 0,
    ) -> None:
        """A fault by hand: at once; see `FaultEntry`."""
        self.add(FaultEntry(kind, for_s=for_s, n=n, address=address, seed=seed))

    def end(self, kind: type[Fault], *, address: int | None = None) -> int:
        """End the lasting faults of a kind, at one address or all; how many there were."""
        now_ns = self._clock.now_ns()
        self.catch_up()
        ended = [it for it in self._lasting if isinstance(it.kind, kind) and address in (None, it.address)]
        for lasting in ended:
            self._over(lasting, now_ns)
        self._look_busy()
        return len(ended)

    def clear(self) -> None:
        """Forget the plan and end all faults: chips are plugged in again, and what was swapped is back."""
        self.catch_up()
        for waiting in (self._plan, self._agenda, self._drawn, self._waiting, self._active):
            waiting.clear()
        while self._lasting:
            self._over(self._lasting[-1], self._clock.now_ns())
        self._look_busy()

    def catch_up(self) -> None:
        """Let happen what was due by now."""
        now_ns = self._clock.now_ns()
        while self._agenda and self._agenda[0][0] <= now_ns:
            t_ns, _, action = heapq.heappop(self._agenda)
            action(t_ns)
        still = [it for it in self._waiting if not self._strike(*it, now_ns)]
        self._waiting = still
        self._look_busy()

    # A transfer, as the adapter makes it

    def begin_transfer(self, address: int) -> None:
        """The first message to come has `address`."""
        if self._in_transfer:
            return
        now_ns = self._clock.now_ns()
        self._in_transfer, self._transfer_ns, self._address, self._held_ns = True, now_ns, address, 0
        self.catch_up()
        for entry, rng, from_ns in self._drawn:
            chosen = entry.address in (None, address) and rng.random() < (entry.p or 0)
            if chosen and now_ns >= from_ns:
                self._happen(entry, rng, now_ns)
        self._active = [it for it in self._active if it.until_ns is None or now_ns < it.until_ns]

    def refuse(self, address: int) -> None:
        """Raise OSError where a fault lets a message to `address` come to nothing."""
        for active in self._acting(address):
            refusal = active.kind.refuse()
            if refusal:
                self._touch(active, address, refusal.touch)
                self._held_ns += round(refusal.held_s * NS_PER_S)
                code = self._adapter.nack_errno if refusal.errno is None else refusal.errno
                raise OSError(code, os.strerror(code))

    def carry(self, address: int, target: Target, payload: bytes | int) -> bytes:
        """A message whose address is acknowledged: what arrives of a read, b"" of a write."""
        if isinstance(payload, int):
            return self._read(address, target, payload)
        cut = False
        for active in self._acting(address):
            spoilt = active.kind.spoil_write(payload, active.rng)
            if spoilt:
                self._touch(active, address, spoilt.touch)
                payload, cut = spoilt.data, cut or spoilt.cut
        self._adapter.carry(target, payload)
        if payload:
            self._pointers[address] = registers_from(payload[0] & 0x7F, len(payload))[-1]
        if cut:
            self._adapter.not_taken()
        return b""

    def end_transfer(self, wire_ns: int) -> int:
        """The transfer is over, which took `wire_ns`; how much longer it takes."""
        for active in self._acting(self._address):
            factor = active.kind.stretch()
            if factor > 1:
                self._touch(active, self._address, Touch(f"{factor:g} times as long"))
                self._held_ns += round((factor - 1) * wire_ns)
        for active in self._active:
            if active.touched and active.left is not None:
                active.left -= 1
            active.touched = False
        self._active = [it for it in self._active if it.left != 0]
        self._in_transfer = False
        self._look_busy()
        return self._held_ns

    def _read(self, address: int, target: Target, n: int) -> bytes:
        pointer = self._pointers.get(address)
        *registers, self._pointers[address] = registers_from(pointer, n + 1)
        answer = b""
        for active in self._acting(address):
            gap = active.kind.split(registers, active.rng)
            if gap:
                self._touch(active, address, gap.touch)
                answer = self._adapter.carry(target, gap.byte)
                if gap.lost:
                    target.read(gap.lost)
                if gap.later_s:
                    target.stop()
                    self._clock.sleep_until_ns(self._clock.now_ns() + round(gap.later_s * NS_PER_S))
                break
        answer += self._adapter.carry(target, n - len(answer))
        for active in self._acting(address):
            spoilt = active.kind.spoil_read(answer, registers, active.rng)
            if spoilt:
                self._touch(active, address, spoilt.touch)
                answer = spoilt.data
        return answer

    def _acting(self, address: int) -> list[_Active]:
        return [it for it in self._active if it.entry.address in (None, address) and not (it.touched and it.kind.once)]

    def _touch(self, active: _Active, address: int, touch: Touch) -> None:
        active.touched = True
        self.history.append(Happened(self._transfer_ns, active.kind, address, touch))

    # The plan

    def _later(self, t_ns: int, action: Callable[[int], None]) -> None:
        self._on_agenda += 1
        heapq.heappush(self._agenda, (t_ns, self._on_agenda, action))

    def _once(self, entry: FaultEntry, rng: Random, t_ns: int) -> None:
        self._plan = [one for one in self._plan if one is not entry]
        self._happen(entry, rng, t_ns)

    def _again(self, entry: FaultEntry, rng: Random, t_ns: int) -> None:
        self._happen(entry, rng, t_ns)
        gap_ns = _gap_ns(entry.per_minute, rng) if entry.per_minute else round((entry.every_s or 0) * NS_PER_S)
        self._later(t_ns + gap_ns, partial(self._again, entry, rng))

    def _happen(self, entry: FaultEntry, rng: Random, t_ns: int) -> None:
        for_ns = None if entry.for_s is None else round(entry.for_s * NS_PER_S)
        if isinstance(entry.kind, WireFault):
            until_ns = None if for_ns is None else t_ns + for_ns
            if until_ns is not None and until_ns <= self._clock.now_ns():
                return  # it met no transfer
            # Of one that comes again before it has met a transfer there is one.
            self._active = [it for it in self._active if it.rng is not rng or it.until_ns is not None]
            left = entry.n if entry.n is not None or for_ns is not None else 1
            self._active.append(_Active(entry, entry.kind, rng, until_ns, left))
        elif isinstance(entry.kind, ChipFault):
            for address in self._chips(entry.address):
                if not self._strike(entry, entry.kind, rng, address, t_ns):
                    self._waiting.append((entry, entry.kind, rng, address))

    def _chips(self, address: int | None) -> list[int]:
        return [
            at
            for at, target in self._adapter.targets.items()
            if isinstance(target, FakeMpu6050) and address in (None, at)
        ]

    def _strike(self, entry: FaultEntry, kind: ChipFault, rng: Random, address: int, t_ns: int) -> bool:
        """Let a fault happen to the chip at `address`; False where it cannot yet."""
        for lasting in [it for it in self._lasting if type(it.kind) is type(kind) and it.address == address]:
            self._over(lasting, t_ns)
        chip = self._adapter.targets.get(address)
        if not isinstance(chip, FakeMpu6050):
            return True  # taken off the wires meanwhile
        with seen_at(chip, self._chips_time_ns(chip, t_ns)):
            struck = kind.strike(Site(chip, partial(self._put, address)), rng)
        if struck is None:
            return False
        self.history.append(Happened(t_ns, kind, address, struck.touch))
        if struck.undo:
            lasting = _Lasting(kind, address, struck.undo)
            self._lasting.append(lasting)
            if entry.for_s is not None:
                self._later(t_ns + round(entry.for_s * NS_PER_S), partial(self._over, lasting))
        return True

    def _over(self, lasting: _Lasting, t_ns: int) -> None:
        if lasting not in self._lasting:
            return
        self._lasting.remove(lasting)
        chip = self._adapter.targets.get(lasting.address)
        if isinstance(chip, FakeMpu6050):
            with seen_at(chip, self._chips_time_ns(chip, t_ns)):
                lasting.undo()
        self.history.append(Happened(t_ns, lasting.kind, lasting.address, Touch("over")))

    def _chips_time_ns(self, chip: FakeMpu6050, t_ns: int) -> int:
        return t_ns if chip.clock is self._clock else chip.clock.now_ns()

    def _put(self, address: int, chip: FakeMpu6050) -> None:
        self._adapter.targets[address] = chip

    def _look_busy(self) -> None:
        self.busy = bool(self._agenda or self._drawn or self._waiting or self._active or self._in_transfer)


def _gap_ns(per_minute: float, rng: Random) -> int:
    return round(rng.expovariate(per_minute / 60) * NS_PER_S)
