"""A strict fake: the transactions of a test, written down in order, and nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Self


@dataclass(frozen=True, slots=True)
class Write:
    """A write of `data` is expected; `error`, where given, is raised by it."""

    address: int
    data: bytes
    error: Exception | None = None

    def __str__(self) -> str:
        return f"write of {self.data.hex(' ')} to 0x{self.address:02x}"


@dataclass(frozen=True, slots=True)
class WriteRead:
    """A combined read of len(`answer`) bytes, or `n`, is expected; it gives `answer` or raises `error`."""

    address: int
    data: bytes
    answer: bytes = b""
    error: Exception | None = None
    n: int | None = None

    @property
    def length(self) -> int:
        """The number of bytes that must be asked for."""
        return len(self.answer) if self.n is None else self.n

    def __str__(self) -> str:
        return f"write of {self.data.hex(' ')} to 0x{self.address:02x}, then read of {self.length}"


class ScriptedBus:
    """A bus that answers exactly the given transactions in their order; implements `quavelet.bus.protocol.I2CBus`.

    Anything else is an AssertionError that says what was expected. Leaving the `with` block, or `done`, fails where
    the script is not at its end.
    """

    def __init__(self, script: Sequence[Write | WriteRead], *, name: str = "fake:script") -> None:
        for step in script:
            if (
                isinstance(step, WriteRead)
                and step.error is None
                and (not step.answer or step.length != len(step.answer))
            ):
                raise ValueError(f"the script has no answer to a {step}: give answer or error")
        self._script = list(script)
        self._at = 0
        self._name = name
        self._closed = False

    @property
    def name(self) -> str:
        return self._name

    def write(self, address: int, data: bytes) -> None:
        self._next(Write(address, bytes(data)))

    def write_read(self, address: int, data: bytes, n: int) -> bytes:
        step = self._next(WriteRead(address, bytes(data), n=n))
        assert isinstance(step, WriteRead)
        return step.answer

    def close(self) -> None:
        self._closed = True

    def done(self) -> None:
        """Fail where a transaction of the script has not happened."""
        left = self._script[self._at :]
        if left:
            raise AssertionError(f"{len(left)} transactions did not happen, the first: {left[0]}")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.close()
        if error is None:  # leftovers would hide the error that caused them
            self.done()

    def _next(self, got: Write | WriteRead) -> Write | WriteRead:
        if self._closed:
            raise AssertionError(f"transaction {self._at}: got a {got} on a closed bus")
        if self._at == len(self._script):
            raise AssertionError(f"transaction {self._at}: expected nothing more, got a {got}")
        step = self._script[self._at]
        if str(step) != str(got):
            raise AssertionError(f"transaction {self._at}: expected a {step}, got a {got}")
        self._at += 1
        if step.error is not None:
            raise step.error
        return step
