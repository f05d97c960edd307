"""An I2C adapter with chips on its wires: messages, and the SMBus calls as the Linux kernel makes them of messages."""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import NoReturn

from hw_fakes.faults.engine import Faults
from hw_fakes.target import Nack, Target
from quavelet.core.clock import Clock, MonotonicClock, VirtualClock
from quavelet.core.units import NS_PER_S

READ = 0x0001  # I2C_M_RD of linux/i2c.h, the only flag of a message this adapter has
BLOCK_MAX = 32
FIRST_ADDRESS, LAST_ADDRESS = 0x08, 0x77  # of 7 bits, without those that I2C keeps for itself

Message = tuple[int, int, bytes | int]
"""Address, flags, and the bytes to write or, with `READ`, how many to read."""


class Size(IntEnum):
    """The kind of an SMBus call, the `size` of linux/i2c.h."""

    QUICK = 0
    BYTE = 1
    BYTE_DATA = 2
    WORD_DATA = 3
    PROC_CALL = 4
    BLOCK_DATA = 5
    I2C_BLOCK_BROKEN = 6
    BLOCK_PROC_CALL = 7
    I2C_BLOCK_DATA = 8


class Adapter:
    """Chips at their addresses on one pair of wires; what every way into the fake ends in.

    On the wire a byte is 9 bit-times, a START, repeated START or STOP one each.

    targets     the chips by address; `attach` adds more, `detach` takes them off
    clock       where it is a virtual one, a transfer moves it on by the time it takes at `speed_hz`, at its end, so
                that what happens meanwhile is seen by the next one
    paced       a transfer takes its time on a real clock too; without, as long as it takes to compute
    faults      what goes wrong, see `Faults`; nothing by itself
    lock        held during a transfer; for who does something to the chips from another thread
    nack_errno  what a missing acknowledge is told as: EREMOTEIO (121) on a Raspberry Pi, ENXIO (6) on many others
    transfers   how many there were, also those that failed
    busy_ns     the time they took on the wire
    """

    functions = 0x0EFF0001
    """I2C and all of SMBus that can be made of it, without packet error codes: I2C_FUNCS of linux/i2c.h."""

    def __init__(
        self,
        targets: Mapping[int, Target] | None = None,
        *,
        clock: Clock | None = None,
        nack_errno: int = errno.EREMOTEIO,
        speed_hz: int = 400_000,
        paced: bool = False,
    ) -> None:
        self.clock = clock
        self.paced = paced
        self._time: Clock = clock or MonotonicClock()
        self.faults = Faults(self, clock=self._time)
        self.lock = threading.RLock()
        self.nack_errno = nack_errno
        self.speed_hz = speed_hz
        self.transfers = 0
        self.busy_ns = 0
        self.targets: dict[int, Target] = {}
        self._begun: dict[int, Target] = {}
        self._bits = 0
        self._begun_ns = 0
        for address, target in (targets or {}).items():
            self.attach(address, target)

    def attach(self, address: int, target: Target) -> None:
        """Put a chip on the wires. Raises ValueError where its address is taken or is none."""
        if not FIRST_ADDRESS <= address <= LAST_ADDRESS:
            raise ValueError(f"0x{address:02x} is no address of a chip: take one from 0x08 to 0x77")
        if address in self.targets:
            raise ValueError(f"two chips at 0x{address:02x}: pull AD0 of one high (0x69), or give it another bus")
        self.targets[address] = target

    def detach(self, address: int) -> Target:
        """Take the chip at `address` off the wires. Raises ValueError where there is none."""
        if address not in self.targets:
            raise ValueError(f"there is no chip at 0x{address:02x} to take off")
        return self.targets.pop(address)

    def transfer(self, messages: Sequence[Message]) -> list[bytes]:
        """One transaction with a repeated START between messages: what each read, b"" of a write.

        Raises OSError with `nack_errno` where a chip does not acknowledge, EOPNOTSUPP for a flag other than `READ`.
        """
        if any(flags & ~READ for _, flags, _ in messages):
            raise os_error(errno.EOPNOTSUPP)
        with self.lock:
            try:
                return [self._message(address, flags, payload) for address, flags, payload in messages]
            finally:
                self._stop()

    def message(self, address: int, flags: int, payload: bytes | int) -> bytes:
        """START or repeated START and one message: what it read, b"" of a write. `stop` ends the transaction.

        Raises OSError as `transfer`.
        """
        with self.lock:
            return self._message(address, flags, payload)

    def stop(self) -> None:
        """STOP: the transaction is over, and its time has passed."""
        with self.lock:
            self._stop()

    def carry(self, target: Target, payload: bytes | int) -> bytes:
        """The bytes of a message over the wires, after its address: what was read, b"" of a write."""
        if isinstance(payload, int):
            answer = target.read(payload)
            self._bits += 9 * payload
            return answer
        target.write(payload)
        self._bits += 9 * len(payload)
        return b""

    def not_taken(self) -> NoReturn:
        """A byte of a write went over the wires, and is not acknowledged."""
        self._bits += 9
        raise Nack

    def _message(self, address: int, flags: int, payload: bytes | int) -> bytes:
        if flags & ~READ:
            raise os_error(errno.EOPNOTSUPP)
        if self.paced and not self._bits:
            self._begun_ns = self._time.now_ns()
        faults = self.faults if self.faults.busy else None
        if faults:
            faults.begin_transfer(address)
        self._bits += 1 + 9  # START and the address
        if faults:
            faults.refuse(address)
        target = self.targets.get(address)
        if target is None:
            raise os_error(self.nack_errno)
        self._begun[address] = target
        try:
            return faults.carry(address, target, payload) if faults else self.carry(target, payload)
        except Nack:
            raise os_error(self.nack_errno) from None

    def _stop(self) -> None:
        for target in self._begun.values():
            target.stop()
        self._begun.clear()
        wire_ns = -(-(self._bits + 1) * NS_PER_S // self.speed_hz)
        held_ns = self.faults.end_transfer(wire_ns) if self.faults.busy else 0
        self._bits = 0
        self.transfers += 1
        self.busy_ns += wire_ns + held_ns
        if isinstance(self.clock, VirtualClock):
            self.clock.advance_ns(wire_ns + held_ns)
        elif self.paced:
            self._time.sleep_until_ns(self._begun_ns + wire_ns + held_ns)
        elif held_ns:
            self._time.sleep_until_ns(self._time.now_ns() + held_ns)

    def smbus(self, address: int, *, read: bool, command: int, size: int, data: bytes) -> bytes:
        """An SMBus call, i2c_smbus_xfer_emulated of the kernel.

        data  the caller's `union i2c_smbus_data`, as far as the call looks at it (`union_length`); the answer is what
              comes to stand at the beginning of it

        Raises OSError as `transfer`, EINVAL for a block longer than 32, EOPNOTSUPP for the calls that let the chip
        say how long its answer is.
        """
        register = bytes([command])
        if size == Size.QUICK:
            self.transfer([(address, READ, 0) if read else (address, 0, b"")])
            return b""
        if size == Size.BYTE:
            return self.transfer([(address, READ, 1) if read else (address, 0, register)])[0]
        if size in (Size.BYTE_DATA, Size.WORD_DATA):
            n = union_length(read=read, size=size)
            if read:
                return self._write_read(address, register, n)
            self.transfer([(address, 0, register + data[:n])])
            return b""
        if size == Size.PROC_CALL:
            return self._write_read(address, register + data[:2], 2)
        if size in (Size.I2C_BLOCK_DATA, Size.I2C_BLOCK_BROKEN):
            # The older of the two has no length when it reads; i2c-dev reads 32.
            n = BLOCK_MAX if size == Size.I2C_BLOCK_BROKEN and read else data[0]
            if n > BLOCK_MAX:
                raise os_error(errno.EINVAL)
            if read:
                return bytes([n]) + self._write_read(address, register, n)
            self.transfer([(address, 0, register + data[1 : 1 + n])])
            return b""
        if size == Size.BLOCK_DATA and not read:
            if data[0] > BLOCK_MAX:
                raise os_error(errno.EINVAL)
            self.transfer([(address, 0, register + data[: 1 + data[0]])])  # the length goes over the wire too
            return b""
        raise os_error(errno.EOPNOTSUPP if size in (Size.BLOCK_DATA, Size.BLOCK_PROC_CALL) else errno.EINVAL)

    def _write_read(self, address: int, data: bytes, n: int) -> bytes:
        return self.transfer([(address, 0, data), (address, READ, n)])[1]


def union_length(*, read: bool, size: int) -> int:
    """How many bytes of the caller's union an SMBus call has; the kernel touches no more."""
    if size == Size.QUICK or (size == Size.BYTE and not read):
        return 0
    if size in (Size.BYTE, Size.BYTE_DATA):
        return 1
    return 2 if size in (Size.WORD_DATA, Size.PROC_CALL) else BLOCK_MAX + 2


def os_error(code: int) -> OSError:
    """The error a system call ends with."""
    return OSError(code, os.strerror(code))
