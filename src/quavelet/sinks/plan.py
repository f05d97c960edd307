"""What an output is made from; its encoding and its transport take from it what they need."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from quavelet.core.wall_clock import OffsetNs
from quavelet.settings import OutputSettings
from quavelet.sinks.status import Status


@dataclass(frozen=True, slots=True)
class OutputPlan:
    """One output to be.

    name      of the output, as in [output.NAME]
    settings  its table
    service   the service's name
    status    the service as it is at this moment; may be called on any thread
    offset_ns from the loop's clock to the time of day
    """

    name: str
    settings: OutputSettings
    service: str
    status: Callable[[], Status]
    offset_ns: OffsetNs
