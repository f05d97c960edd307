"""The auxiliary I2C bus of the MPU-6050: its master, which reads other chips at each sample, and the bypass around it.

Registers are those of RM-MPU-6000A-00 rev 4.2 ("RM").
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

from hw_fakes.chip import registers as reg
from hw_fakes.target import Nack, Target
from quavelet.core.clock import Clock
from quavelet.core.units import NS_PER_S

I2C_MST_CTRL = 0x24
SLV0_ADDR = 0x25  # address, register and control of slave n at 3 n from here
SLV4_ADDR, SLV4_REG, SLV4_DO, SLV4_CTRL, SLV4_DI = range(0x31, 0x36)
I2C_MST_STATUS = 0x36
EXT_SENS_DATA, EXT_SENS_BYTES = 0x49, 24
SLV0_DO = 0x63
I2C_MST_DELAY_CTRL = 0x67
SLAVES = range(4)

WAIT_FOR_ES, SLV3_FIFO_EN = 0x40, 0x20  # I2C_MST_CTRL
EN, BYTE_SW, REG_DIS, GRP, LEN = 0x80, 0x40, 0x20, 0x10, 0x0F  # I2C_SLVn_CTRL
SLV4_INT_EN, MST_DLY = 0x40, 0x1F  # I2C_SLV4_CTRL, beside EN and REG_DIS
SLV4_NACK, SLV4_DONE = 0x10, 0x40  # I2C_MST_STATUS; bit n: slave n was not acknowledged
I2C_BYPASS_EN = 0x02  # INT_PIN_CFG

# RM register 36: 8 MHz divided by this is the clock, 348 kHz for 0 and 400 kHz for 13.
DIVIDERS = (23, 24, 25, 26, 27, 28, 29, 30, 31, 16, 17, 18, 19, 20, 21, 22)


class SettableClock:
    """The time of the chips on the auxiliary bus.

    It is the outer clock's, by which they are spoken to through the bypass, but within `at` it is a sample's instant:
    the chip takes its samples when someone looks, which is later than they fell. It never goes back: once it has told
    a time, an earlier instant counts as that time.
    """

    def __init__(self, outer: Clock) -> None:
        self.outer = outer
        self._set_ns: int | None = None
        self._latest_ns = outer.now_ns()

    def now_ns(self) -> int:
        now_ns = self.outer.now_ns() if self._set_ns is None else self._set_ns
        self._latest_ns = max(self._latest_ns, now_ns)
        return self._latest_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        self.outer.sleep_until_ns(t_ns)

    @contextmanager
    def at(self, t_ns: int) -> Iterator[None]:
        """Let it be `t_ns` within the block."""
        before, self._set_ns = self._set_ns, t_ns
        try:
            yield
        finally:
            self._set_ns = before


class Bypassed:
    """A chip of the auxiliary bus as the outer one sees it: there only while the bypass is open; a `Target`."""

    def __init__(self, target: Target, is_open: Callable[[], bool]) -> None:
        self._target = target
        self._is_open = is_open

    def write(self, data: bytes) -> None:
        self._let_through()
        self._target.write(data)

    def read(self, n: int) -> bytes:
        self._let_through()
        return self._target.read(n)

    def stop(self) -> None:
        self._target.stop()

    def _let_through(self) -> None:
        if not self._is_open():
            raise Nack


@dataclass(frozen=True, slots=True)
class _Transaction:
    """What a slave's registers ask for: `length` bytes to be read, or one to be written."""

    address: int
    register: int
    bare: bool  # without the register's number
    length: int = 0
    output: int = 0

    @property
    def bits(self) -> int:
        """Bit-times on the wire: 9 a byte, and one for each START, repeated START and STOP."""
        head = 2 + 9 + (0 if self.bare else 9)
        if not self.length:
            return head + 9
        return head + 9 * self.length + (0 if self.bare else 1 + 9)

    def run(self, target: Target) -> bytes:
        """Do it, and return what is read. Raises `Nack`."""
        head = b"" if self.bare else bytes([self.register])
        try:
            if not self.length:
                target.write(head + bytes([self.output]))
                return b""
            if head:
                target.write(head)
            return target.read(self.length)
        finally:
            target.stop()


_NACK_BITS = 2 + 9


class AuxMaster:
    """The master of the auxiliary bus, which works on the chip's register file of 128 bytes.

    It writes there EXT_SENS_DATA, I2C_SLV4_DI, bits of I2C_MST_STATUS, which its owner clears when that is read, and
    the enable bit of slave 4. All transactions of a sample happen at the instant of the sample. `follow` must be
    called after each write to the registers.

    A slave that is to be written gets its one output byte at each sample, whatever its length (but 0: nothing).
    Not there: several masters and lost arbitration, the FSYNC bit PASS_THROUGH, I2C_MST_P_NSR, DELAY_ES_SHADOW (the
    external data are always whole), a transfer longer than the sample's period.

    targets  the chips by address; their clock is `clock`
    busy_ns  time on the auxiliary wires so far, at the clock that I2C_MST_CTRL sets
    """

    def __init__(self, targets: Mapping[int, Target], *, clock: SettableClock) -> None:
        self.targets = dict(targets)
        self.clock = clock
        self.busy_ns = 0
        self._lengths: dict[int, int] = {}  # bytes that each read slave has in EXT_SENS_DATA
        self._registers: bytes | bytearray = bytes(reg.COUNT)

    def behind(self, registers: bytes | bytearray) -> None:
        """From now on it is the chip with this register file that opens and closes the bypass."""
        self._registers = registers

    def active(self, registers: bytes | bytearray) -> bool:
        """Whether a sample would do anything: the master is on, and so is a slave."""
        if not registers[reg.USER_CTRL] & reg.USER_I2C_MST_EN:
            return False
        return any(_enabled(registers, n) for n in SLAVES) or bool(registers[SLV4_CTRL] & EN)

    def bypass(self, registers: bytes | bytearray) -> bool:
        """Whether the auxiliary wires are connected to the outer ones (RM register 55)."""
        if registers[reg.USER_CTRL] & reg.USER_I2C_MST_EN:
            return False
        return bool(registers[reg.INT_PIN_CFG] & I2C_BYPASS_EN)

    def outside(self) -> dict[int, Bypassed]:
        """The chips as the outer bus sees them, by address."""
        return {
            address: Bypassed(target, lambda: self.bypass(self._registers)) for address, target in self.targets.items()
        }

    def reset(self) -> None:
        """I2C_MST_RESET: the places in EXT_SENS_DATA are given anew."""
        self._lengths.clear()

    def follow(self, registers: bytes | bytearray) -> None:
        """See the slaves as they are now; nothing else happens.

        Places in EXT_SENS_DATA go in the order of the slaves. One that is disabled keeps its place until all are, or
        until `reset` (RM registers 73 to 96).
        """
        enabled = [n for n in SLAVES if registers[SLV0_ADDR + 3 * n + 2] & EN]
        if not enabled:
            self._lengths.clear()
        for n in enabled:
            if registers[SLV0_ADDR + 3 * n] & 0x80:
                self._lengths[n] = registers[SLV0_ADDR + 3 * n + 2] & LEN

    def sample(self, registers: bytearray, sample_number: int, t_ns: int) -> bool:
        """Do the transactions of a sample that falls at `t_ns`; True where I2C_MST_INT is to be raised.

        That is where a slave is not acknowledged, or slave 4 is done and its interrupt enabled (RM registers 52, 54).
        """
        self.follow(registers)
        if not self.active(registers):
            return False
        interrupt = False
        with self.clock.at(t_ns):
            for n in self._due(registers, sample_number):
                answer = self._run(registers, _transaction(registers, n))
                if answer is None:
                    registers[I2C_MST_STATUS] |= 1 << n
                    interrupt = True
                elif answer:
                    self._keep(registers, n, answer)
            if registers[SLV4_CTRL] & EN and _is_due(registers, 4, sample_number):
                interrupt = self._run_slave_4(registers) or interrupt
        return interrupt

    def fifo_bytes(self, registers: bytes | bytearray) -> bytes:
        """The external bytes of a frame: of the slaves whose FIFO bit is set, in the order of the slaves.

        Not certain: a slave that was disabled still puts its old bytes there, as it keeps its place (RM register 35);
        with the master off there are none.
        """
        if not registers[reg.USER_CTRL] & reg.USER_I2C_MST_EN:
            return b""
        frame = bytearray()
        for n, place in self._places().items():
            asked = registers[reg.FIFO_EN] & 1 << n if n < 3 else registers[I2C_MST_CTRL] & SLV3_FIFO_EN
            if asked:
                frame += registers[place.start : place.stop]
        return bytes(frame)

    def delay_ns(self, registers: bytes | bytearray, sample_number: int = 0) -> int:
        """How much later data ready comes because of WAIT_FOR_ES (RM register 36); a sample 0 has all slaves due."""
        if not registers[I2C_MST_CTRL] & WAIT_FOR_ES or not self.active(registers):
            return 0
        bits = 0
        for n in self._due(registers, sample_number):
            transaction = _transaction(registers, n)
            bits += transaction.bits if transaction.address in self.targets else _NACK_BITS
        return _wire_ns(registers, bits)

    def _due(self, registers: bytes | bytearray, sample_number: int) -> list[int]:
        return [n for n in SLAVES if _enabled(registers, n) and _is_due(registers, n, sample_number)]

    def _run(self, registers: bytearray, transaction: _Transaction) -> bytes | None:
        """What is read; None where nobody acknowledges."""
        target = self.targets.get(transaction.address)
        try:
            if target is None:
                raise Nack
            answer = transaction.run(target)
        except Nack:
            self.busy_ns += _wire_ns(registers, _NACK_BITS)
            return None
        self.busy_ns += _wire_ns(registers, transaction.bits)
        return answer

    def _run_slave_4(self, registers: bytearray) -> bool:
        control = registers[SLV4_CTRL]
        read = bool(registers[SLV4_ADDR] & 0x80)
        answer = self._run(
            registers,
            _Transaction(
                registers[SLV4_ADDR] & 0x7F,
                registers[SLV4_REG],
                bare=bool(control & REG_DIS),
                length=1 if read else 0,
                output=registers[SLV4_DO],
            ),
        )
        registers[SLV4_CTRL] &= ~EN & 0xFF
        registers[I2C_MST_STATUS] |= SLV4_DONE
        if answer is None:
            registers[I2C_MST_STATUS] |= SLV4_NACK
        elif answer:
            registers[SLV4_DI] = answer[0]
        return answer is None or bool(control & SLV4_INT_EN)

    def _places(self) -> dict[int, range]:
        """The registers of each read slave; what goes beyond the last one is lost."""
        places, first, end = {}, EXT_SENS_DATA, EXT_SENS_DATA + EXT_SENS_BYTES
        for n in sorted(self._lengths):
            last = min(first + self._lengths[n], end)
            places[n] = range(first, last)
            first = last
        return places

    def _keep(self, registers: bytearray, n: int, answer: bytes) -> None:
        control, place = registers[SLV0_ADDR + 3 * n + 2], self._places()[n]
        if control & BYTE_SW:
            answer = _swapped(answer, registers[SLV0_ADDR + 3 * n + 1], odd_first=bool(control & GRP))
        kept = answer[: len(place)]
        registers[place.start : place.start + len(kept)] = kept


def _enabled(registers: bytes | bytearray, n: int) -> bool:
    """RM register 39: a slave without bytes to be transferred does nothing."""
    control = registers[SLV0_ADDR + 3 * n + 2]
    return bool(control & EN) and bool(control & LEN)


def _is_due(registers: bytes | bytearray, n: int, sample_number: int) -> bool:
    """RM registers 52 and 103: a slave whose delay bit is set is accessed every 1 + I2C_MST_DLY samples."""
    if not registers[I2C_MST_DELAY_CTRL] & 1 << n:
        return True
    return sample_number % (1 + (registers[SLV4_CTRL] & MST_DLY)) == 0


def _transaction(registers: bytes | bytearray, n: int) -> _Transaction:
    address, register, control = registers[SLV0_ADDR + 3 * n : SLV0_ADDR + 3 * n + 3]
    return _Transaction(
        address & 0x7F,
        register,
        bare=bool(control & REG_DIS),
        length=control & LEN if address & 0x80 else 0,
        output=registers[SLV0_DO + n],
    )


def _swapped(data: bytes, register: int, *, odd_first: bool) -> bytes:
    """The two bytes of each word exchanged; words begin at even registers, or at odd ones (RM register 39)."""
    swapped = bytearray(data)
    for i in range((register + odd_first) % 2, len(data) - 1, 2):
        swapped[i : i + 2] = data[i + 1], data[i]
    return bytes(swapped)


def _wire_ns(registers: bytes | bytearray, bits: int) -> int:
    return -(-bits * DIVIDERS[registers[I2C_MST_CTRL] & 0x0F] * NS_PER_S // 8_000_000)
