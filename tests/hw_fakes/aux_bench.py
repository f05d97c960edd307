"""An auxiliary master on a register file, in virtual time, and chips that show what it does."""

from __future__ import annotations

from hw_fakes.chip.aux_master import AuxMaster, SettableClock
from hw_fakes.target import Nack
from quavelet.core.clock import VirtualClock

CHIP, OTHER, NOBODY = 0x0C, 0x1E, 0x55
EXT, DI, STATUS, SLV4_CTRL = 0x49, 0x35, 0x36, 0x34
READ, EN = 0x80, 0x80


class Memory:
    """A chip of 256 bytes that counts up, and writes down what it is told."""

    def __init__(self, first=0):
        self.bytes = bytearray((first + i) & 0xFF for i in range(256))
        self.pointer = 0
        self.log = []

    def write(self, data):
        self.log.append(("write", data))
        if data:
            self.pointer = data[0]
        for value in data[1:]:
            self.bytes[self.pointer] = value
            self.pointer = (self.pointer + 1) % 256

    def read(self, n):
        self.log.append(("read", n))
        answer = bytes(self.bytes[(self.pointer + i) % 256] for i in range(n))
        self.pointer = (self.pointer + n) % 256
        return answer

    def stop(self):
        self.log.append(("stop",))


class Silent:
    """Something that acknowledges nothing."""

    def write(self, _data):
        raise Nack

    def read(self, _n):
        raise Nack

    def stop(self):
        return


class Bench:
    """A register file with a master that is on, and the time of its samples."""

    def __init__(self, targets=None, *, clock=None):
        self.clock = SettableClock(VirtualClock()) if clock is None else clock
        self.outer = self.clock.outer
        self.registers = bytearray(128)
        self.registers[0x6A] = 0x20
        self.master = AuxMaster({CHIP: Memory(), OTHER: Memory(100)} if targets is None else targets, clock=self.clock)
        self.samples = 0

    def wr(self, register, *values):
        self.registers[register : register + len(values)] = bytes(values)
        self.master.follow(self.registers)

    def slave(self, n, address, register, control, output=0):
        self.wr(0x63 + n, output)
        self.wr(0x25 + 3 * n, address, register, control)

    def slave_4(self, address, register, *, output=0, control=EN):
        self.wr(0x31, address, register, output, control)

    def sample(self, t_ns=None):
        self.samples += 1
        if t_ns is None:
            t_ns = self.outer.now_ns()
        return self.master.sample(self.registers, self.samples - 1, t_ns)

    def ext(self, n, first=0):
        return bytes(self.registers[EXT + first : EXT + first + n])
