"""The memory of the digital motion processor; the processor itself is not there, so nothing in it is ever run."""

from __future__ import annotations

from hw_fakes.chip import registers as reg

BANKS, BANK_SIZE = 12, 256
_BANK = 0x1F  # in BANK_SEL; above it PRFTCH_EN and CFG_USER_BANK


class DmpMemory:
    """12 banks of 256 bytes behind MEM_R_W, at the address that BANK_SEL and MEM_START_ADDR give.

    Not in RM rev 4.2; drivers that load the processor's program write it in blocks to MEM_R_W, and read it back to see
    whether it arrived. Each byte moves MEM_START_ADDR on, at the end of a bank to its beginning. Banks above the
    eleventh, where drivers look for the part's revision, read 0 and keep nothing.
    """

    def __init__(self) -> None:
        self.content = bytearray(BANKS * BANK_SIZE)

    def clear(self) -> None:
        """All bytes become 0."""
        self.content[:] = bytes(len(self.content))

    def read(self, registers: bytearray) -> int:
        """The byte at the address, which then goes on."""
        at = self._next(registers)
        return 0 if at is None else self.content[at]

    def write(self, registers: bytearray, value: int) -> None:
        """Put a byte at the address, which then goes on."""
        at = self._next(registers)
        if at is not None:
            self.content[at] = value

    def _next(self, registers: bytearray) -> int | None:
        bank, offset = registers[reg.BANK_SEL] & _BANK, registers[reg.MEM_START_ADDR]
        registers[reg.MEM_START_ADDR] = (offset + 1) % BANK_SIZE
        return bank * BANK_SIZE + offset if bank < BANKS else None
