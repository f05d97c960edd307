"""What an instance may do beyond the unit, by its settings: drop-ins of its own."""

from __future__ import annotations

from pathlib import Path

from quavelet.core.paths import expanded
from quavelet.settings import Settings
from quavelet.settings.service import AUTO

NETWORK = "network.conf"
GPIO = "gpio.conf"
DROP_INS = (NETWORK, GPIO)
ITS_OWN = (Path("/var/lib/quavelet"), Path("/run/quavelet"))
"""Where the unit lets it write."""


def needed(settings: Settings) -> dict[str, str]:
    """The drop-ins that these settings need, each with the reason."""
    found = {}
    ways = {output.destination.way for output in settings.output.values()}
    if settings.service.metrics or settings.web.listen or not ways <= {"stdout", "unix"}:
        found[NETWORK] = "the settings have outputs over the network, or the page"
    label = settings.bus.int_line.rpartition(":")[0]
    if label not in ("", "fake"):
        found[GPIO] = f"the settings have a data-ready line at {label}"
    return found


def written_elsewhere(settings: Settings) -> list[Path]:
    """The folders that these settings have it write to and the unit does not let it."""
    files = [settings.service.socket, settings.service.state_file]
    files += [output.destination.path for output in settings.output.values() if output.destination.way == "unix"]
    folders = [settings.recording.directory, settings.web.recordings]
    wanted = [expanded(path).parent for path in files if path not in ("", AUTO)]
    wanted += [expanded(path) for path in folders if path not in ("", AUTO)]
    return sorted({path for path in wanted if not any(path.is_relative_to(own) for own in ITS_OWN)})
