"""systemd's notification protocol: one datagram of NAME=VALUE lines (sd_notify(3)), without libsystemd."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, MutableMapping

LONGEST_STATUS = 500
"""Characters; systemd shows a status on one line."""


class Notify:
    """Tells systemd what the service is at; does nothing where nobody wants to know.

    Nothing waits and nothing is raised: a datagram that cannot be sent is told once and left out, and the watchdog
    draws its own conclusions from that.
    """

    def __init__(self, address: str = "", *, watchdog_us: int = 0, talk: Callable[[str], None] = print) -> None:
        """address is a path or, with a leading @, an abstract socket; "" for none. watchdog_us is what WATCHDOG=1 must
        come within, 0 where nobody watches."""
        self.watchdog_us = watchdog_us
        self._talk = talk
        self._failed = False
        self._socket: socket.socket | None = None
        if not address:
            return
        if address[0] not in "/@":
            self._fail(f"NOTIFY_SOCKET = {address!r} is neither a path nor an abstract socket")
            return
        self._address = "\0" + address[1:] if address[0] == "@" else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK)

    @classmethod
    def from_environment(cls, environment: MutableMapping[str, str], *, talk: Callable[[str], None]) -> Notify:
        """What systemd asked for, taken out of the environment so that no child speaks in our name."""
        address = environment.pop("NOTIFY_SOCKET", "")
        usec, pid = environment.pop("WATCHDOG_USEC", ""), environment.pop("WATCHDOG_PID", "")
        ours = pid in ("", str(os.getpid()))
        watchdog_us = int(usec) if ours and usec.isascii() and usec.isdigit() and len(usec) < 20 else 0
        return cls(address, watchdog_us=watchdog_us, talk=talk)

    @property
    def wanted(self) -> bool:
        """Whether somebody listens."""
        return self._socket is not None

    def send(self, **fields: str | int) -> bool:
        """One datagram: STATUS="running", READY=1 and so on. False where it could not be sent, as when systemd is too
        busy to take it: what must arrive is to be sent again."""
        if self._socket is None:
            return True
        if "STATUS" in fields:
            fields["STATUS"] = " ".join(str(fields["STATUS"]).split())[:LONGEST_STATUS]
        text = "\n".join(f"{name}={value}" for name, value in fields.items())
        try:
            self._socket.sendto(text.encode("utf-8", "replace"), self._address)
        except OSError as error:
            self._fail(str(error.strerror or error))
            return False
        self._failed = False
        return True

    def close(self) -> None:
        """Nothing can be said after it; may be called twice."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _fail(self, reason: str) -> None:
        if not self._failed:
            self._talk(f"systemd cannot be told how it is going ({reason})")
        self._failed = True
