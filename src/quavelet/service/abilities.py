"""What can be done from the page of every service."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from quavelet.recording.recorder import RotatingRecorder
from quavelet.service.page_mounting import MountingAbility
from quavelet.service.page_recording import RecordAbility
from quavelet.service.page_zero import ZeroAbility
from quavelet.service.recordings import drain_recorder
from quavelet.web.ability import Ability

if TYPE_CHECKING:
    from quavelet.service.service import Service


def abilities_of(service: Service, *, environ: Mapping[str, str]) -> list[Ability]:
    """Those of this service, none where it has no page."""
    settings = service.settings
    if not settings.web.listen:
        return []

    def recorder(directory: Path) -> RotatingRecorder:
        return service.asked_by(
            drain_recorder(
                directory,
                settings=settings,
                name=service.name,
                clock=service.clock,
                time_of_day=service.time_of_day,
                tell=service.talk,
                joins=True,
            )
        )

    record = RecordAbility(
        settings,
        service=service.name,
        clock=service.clock,
        environ=environ,
        records=service.records,
        policy=service.policy,
        begin=recorder,
        always=service.recording_stats,
        threads=service.threads_begun,
    )
    return [ZeroAbility(lambda: service.imu), record, MountingAbility(settings.mounting.axes)]
