"""Why there is no broker, in one sentence that says what to do."""

from __future__ import annotations

import socket
import ssl
from datetime import UTC, datetime

from quavelet.core.errors import ImuError
from quavelet.settings.outputs import MqttSettings

# Reason codes of CONNACK and DISCONNECT (MQTT 5.0, 2.4) that time does not mend.
_LASTING = {
    0x84: "it does not speak MQTT 5: use a broker that does",
    0x85: "it does not take the client_id: give another",
    0x86: "user or password is wrong: see user and password_file",
    0x87: "it does not let this user in: see user, password_file and its access list",
    0x8A: "it has banned this client: ask who keeps it",
    0x8C: "it wants another way to log in than user and password",
    0x8E: "another client came with the same client_id: give each its own",
    0x90: "it does not take the topic: give another",
    0x9A: "it keeps no retained messages: allow them there",
    0x9B: "it does not take this qos: give a lower one",
}

_OUT_OF_DATE = (9, 10)
"""X509_V_ERR_CERT_NOT_YET_VALID and X509_V_ERR_CERT_HAS_EXPIRED of OpenSSL."""


class Trouble(ImuError):
    """Why there is no connection. `lasting`: trying again soon is of no use, a person must mend something."""

    def __init__(self, message: str, *, lasting: bool = False) -> None:
        super().__init__(message)
        self.lasting = lasting


def of_reason(code: int, name: str, *, broker: str) -> Trouble:
    """What a reason code of the broker means to the one who reads the log."""
    if code in _LASTING:
        return Trouble(f"{broker}: {_LASTING[code]}", lasting=True)
    return Trouble(f"{broker} has ended the connection ({name.lower()})")


def of_error(error: Exception, *, mqtt: MqttSettings, broker: str) -> Trouble:
    """What an error while connecting means."""
    if isinstance(error, ssl.SSLCertVerificationError):
        why = error.verify_message.rstrip(".") or "not verified"
        if error.verify_code in _OUT_OF_DATE:
            # A machine without a battery clock starts in the past; a time server mends it, and the next try holds.
            return Trouble(
                f"{broker} shows a certificate that does not hold by the time here, "
                f"{datetime.now(UTC):%Y-%m-%d} ({why}): is the time right (see `timedatectl`), or is it to be renewed?",
                lasting=True,
            )
        ca = mqtt.ca_file or "the system's"
        return Trouble(
            f"{broker} shows a certificate that does not hold ({why}): check the host's name and ca_file ({ca})",
            lasting=True,
        )
    if isinstance(error, ssl.SSLError):
        why = (error.reason or "TLS failed").lower().replace("_", " ")
        return Trouble(f"{broker} ends TLS ({why}): is that its TLS port, and what certificate of ours does it want?")
    if isinstance(error, socket.gaierror | UnicodeError):
        return Trouble(f"{broker}: no such host is known: check the name and the network")
    if isinstance(error, TimeoutError):
        return Trouble(f"{broker} does not answer: check the address, the network and its firewall")
    said = (isinstance(error, OSError) and error.strerror) or str(error)
    return Trouble(f"{broker}: {said}: is the broker running and the network up?")
