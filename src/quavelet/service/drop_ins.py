"""What an instance may do beyond the unit, by its settings: drop-ins of its own."""

from __future__ import annotations

from quavelet.settings import Settings

NETWORK = "network.conf"
GPIO = "gpio.conf"
DROP_INS = (NETWORK, GPIO)


def needed(settings: Settings) -> dict[str, str]:
    """The drop-ins that these settings need, each with the reason."""
    found = {}
    ways = {output.destination.way for output in settings.output.values()}
    if settings.service.metrics or settings.web.listen or not ways <= {"stdout", "unix"}:
        found[NETWORK] = "the settings have outputs over the network"
    label = settings.bus.int_line.rpartition(":")[0]
    if label not in ("", "fake"):
        found[GPIO] = f"the settings have a data-ready line at {label}"
    return found
