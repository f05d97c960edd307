"""The FIFO: bytes that know nothing of frames, 1024 of them in the MPU-6050 (RM registers 114 and 115)."""

from __future__ import annotations

SIZE = 1024


class Fifo:
    """Bytes in, bytes out, oldest first.

    stops  what does not fit is lost, to the byte; otherwise it pushes the oldest out
    """

    def __init__(self, *, size: int = SIZE) -> None:
        self.size = size
        self.stops = False
        self.content = bytearray()
        self.last_read = 0

    def __len__(self) -> int:
        return len(self.content)

    def push(self, data: bytes) -> bool:
        """Take `data`; True where bytes were lost for it."""
        self.content += data
        lost = len(self.content) - self.size
        if lost <= 0:
            return False
        if self.stops:
            del self.content[self.size :]
        else:
            del self.content[:lost]
        return True

    def pop(self, n: int) -> bytes:
        """The next `n` bytes; once empty, the last byte read again and again (RM register 116)."""
        data = bytes(self.content[:n])
        del self.content[:n]
        if data:
            self.last_read = data[-1]
        return data + bytes([self.last_read]) * (n - len(data))

    def resize(self, size: int) -> None:
        """Hold `size` bytes from now on; of more, the newest are kept."""
        self.size = size
        del self.content[: max(0, len(self.content) - size)]

    def clear(self) -> None:
        """Forget all bytes."""
        self.content.clear()
