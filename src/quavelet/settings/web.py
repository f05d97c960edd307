"""The live page, [web]: where it is served, to how many, and how often."""

from __future__ import annotations

import msgspec

from quavelet.core.errors import SettingsError
from quavelet.settings.service import AUTO, host_and_port

LOOPBACK = "127.0.0.1"
PORT = 8050


class WebSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The live page in a browser; it needs `pip install 'quavelet[web]'`.

    listen       "HOST:PORT" where it is served, as "127.0.0.1:8050"; "": nowhere. At localhost, 127.0.0.1 and [::1] all
                 who are on this machine may look; anywhere else, as at 0.0.0.0 for all of the network, a token is asked
                 for
    token_file   a file that holds nothing but that token, 16 characters or more, readable by the service's user alone;
                 one that is missing is made. "": none, a new token at each start. "auto": NAME.token in systemd's
                 $STATE_DIRECTORY, else none
    viewers      at most so many at once
    rate_hz      at most so many messages a second go to each
    recordings   the directory of what is recorded from the page, within the bounds of [recording]; "": it cannot be.
                 "auto": recordings in systemd's $STATE_DIRECTORY, else ~/.local/state/quavelet/recordings
    """

    listen: str = ""
    token_file: str = AUTO
    viewers: int = 8
    rate_hz: float = 30.0
    recordings: str = AUTO

    def __post_init__(self) -> None:
        if self.listen:
            host_and_port(self.listen, key="listen")
        for key, path in (("token_file", self.token_file), ("recordings", self.recordings)):
            if "\0" in path:
                raise SettingsError(f"{key} is no path: leave the NUL out")
        if not 1 <= self.viewers <= 32:
            raise SettingsError(f"viewers = {self.viewers} does not fit: give 1 to 32")
        if not 1.0 <= self.rate_hz <= 100.0:
            raise SettingsError(f"rate_hz = {self.rate_hz:g} does not fit: give 1 to 100")

    @property
    def address(self) -> tuple[str, int]:
        """The host and the port of `listen`."""
        return host_and_port(self.listen, key="web.listen")


def page_address(listen: str, *, port: int | None) -> str:
    """`listen` with another port; on this machine only where it says nothing."""
    host, given = host_and_port(listen, key="web.listen") if listen else (LOOPBACK, PORT)
    return f"{f'[{host}]' if ':' in host else host}:{given if port is None else port}"
