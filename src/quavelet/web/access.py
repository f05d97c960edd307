"""Who may look: on this machine all, from elsewhere who knows the token; and no other page may act for a viewer."""

from __future__ import annotations

import hmac
import os
import re
import secrets
import socket
import stat
from collections.abc import Mapping
from pathlib import Path

from quavelet.core.errors import SettingsError
from quavelet.core.paths import expanded
from quavelet.settings.service import AUTO
from quavelet.settings.web import WebSettings

LOOPBACK = ("localhost", "127.0.0.1", "::1")
SHORTEST_TOKEN, LONGEST_TOKEN = 16, 512
HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
        "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
    ),
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    # It would name its version otherwise.
    "Server": "quavelet",
}
"""On every answer."""
ALONE = ("Cross-Origin-Opener-Policy", "same-origin")
"""On this machine, too; a browser heeds it there and over TLS only, and complains of it elsewhere."""


class Access:
    """What is asked of a request. `token` is "" where the page is for this machine only."""

    def __init__(self, token: str, *, port: int) -> None:
        self.token = token
        # Cookies know no ports: two services on one machine need two names.
        self.cookie = f"quavelet-{port}"
        self._ticket = hmac.digest(token.encode(), b"quavelet page", "sha256").hex() if token else ""

    def refusal_of_host(self, hosts: list[str]) -> str:
        """Why the page does not answer under that name; "" where it does.

        A page from elsewhere whose name was made to point at this machine (DNS rebinding) comes with that name. Where
        a token is asked for it has no cookie, which belongs to the name it was given under.
        """
        if len(hosts) != 1:
            return "a request names one Host"
        if not self.token and not is_loopback(_name(hosts[0])):
            return "this page is for this machine only: ask for it as localhost, 127.0.0.1 or [::1]"
        return ""

    def is_of_this_page(self, origins: list[str], host: str) -> bool:
        """Whether the request was made by the page itself and not by another in the same browser."""
        return len(origins) == 1 and origins[0].lower() in (f"http://{host}".lower(), f"https://{host}".lower())

    def is_token(self, given: str) -> bool:
        return bool(self.token) and hmac.compare_digest(given.encode("utf-8", "replace"), self.token.encode())

    def is_known(self, cookies: Mapping[str, str]) -> bool:
        """Whether a token was given before, or none is needed."""
        given = cookies.get(self.cookie, "").encode("utf-8", "replace")
        return not self.token or hmac.compare_digest(given, self._ticket.encode())

    @property
    def set_cookie(self) -> str:
        """The header that says so the next time, a year long."""
        return f"{self.cookie}={self._ticket}; HttpOnly; SameSite=Strict; Path=/; Max-Age=31536000"


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches that address."""
    return host.lower() in LOOPBACK or re.fullmatch(r"127(\.\d{1,3}){3}", host) is not None


def own_address(host: str) -> str:
    """What others are to ask for: `host`, or this machine's own address where it listens on all of them."""
    if host not in ("0.0.0.0", "::"):
        return host
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        try:
            # Nothing is sent: the system only looks up which of its addresses it would send from (RFC 5737).
            sock.connect(("192.0.2.1", 9))
            return str(sock.getsockname()[0])
        except OSError:
            return socket.gethostname()


def token_path(settings: WebSettings, *, name: str, environ: Mapping[str, str]) -> Path | None:
    """Where the token is kept, None for nowhere."""
    if settings.token_file != AUTO:
        return expanded(settings.token_file) if settings.token_file else None
    given = environ.get("STATE_DIRECTORY", "").partition(":")[0]
    return Path(given) / f"{name}.token" if given else None


def token_at(path: Path | None) -> tuple[str, bool]:
    """The token, and whether it was made this very time. Raises SettingsError where the file is of no use."""
    if path is None:
        return secrets.token_urlsafe(), True
    try:
        return _read(path), False
    except FileNotFoundError:
        return _made(path), True
    except SettingsError:
        raise
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or "no text"
        raise SettingsError(
            f"web.token_file {path}: cannot be read ({reason}): let the service's user read it"
        ) from None


def _read(path: Path) -> str:
    if path.exists() and not path.is_file():
        raise SettingsError(f"web.token_file {path}: is no file: give the path of one")
    with path.open("rb") as file:
        if stat.S_IMODE(os.fstat(file.fileno()).st_mode) & stat.S_IROTH:
            raise SettingsError(f"web.token_file {path}: every user of this machine can read it: chmod 600 it")
        token = file.read(LONGEST_TOKEN + 3).decode("ascii").rstrip("\r\n")
    if not SHORTEST_TOKEN <= len(token) <= LONGEST_TOKEN or not re.fullmatch(r"[!-~]+", token):
        raise SettingsError(
            f"web.token_file {path}: holds no token: write {SHORTEST_TOKEN} characters or more, no spaces, or delete "
            "it, and one is made"
        )
    return token


def _made(path: Path) -> str:
    token = secrets.token_urlsafe()
    try:
        # O_EXCL: never through a link that somebody has put there.
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        with os.fdopen(descriptor, "w") as file:
            file.write(f"{token}\n")
    except OSError as error:
        raise SettingsError(
            f"web.token_file {path}: cannot be written ({error.strerror}): make its folder, or give another place"
        ) from error
    return token


def _name(host: str) -> str:
    """The host without its port."""
    match = re.fullmatch(r"(?:\[([0-9A-Fa-f:]+)\]|([^:\[\]]+))(?::\d{1,5})?", host)
    return (match[1] or match[2]).lower() if match else ""
