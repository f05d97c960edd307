"""The stages in a row, built from settings: the same object live and offline."""

from __future__ import annotations

from dataclasses import dataclass, replace

from quavelet.attitude.doubt import Residual
from quavelet.attitude.pid import PidFilter, PidState
from quavelet.calibration.calibrate import Calibrate
from quavelet.calibration.model import UNCALIBRATED, ImuCalibration
from quavelet.calibration.still_bias import StillBias, StillBiasState
from quavelet.core.blocks import AttitudeBlock, RawBlock
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2
from quavelet.settings import Settings


@dataclass(frozen=True, slots=True)
class PipelineState:
    """The memory of every stage."""

    still_bias: StillBiasState
    filter: PidState


class Pipeline:
    """`RawBlock` to `AttitudeBlock`: calibrate, take the bias at rest, filter. A `Stage` itself."""

    def __init__(self, calibrate: Calibrate, still_bias: StillBias, attitude: PidFilter) -> None:
        self._calibrate = calibrate
        self._still_bias = still_bias
        self._attitude = attitude

    def process(self, block: RawBlock) -> AttitudeBlock:
        return self._attitude.process(self._still_bias.process(self._calibrate.process(block)))

    def state(self) -> PipelineState:
        return PipelineState(self._still_bias.state(), self._attitude.state())

    def restore(self, state: PipelineState) -> None:
        self._still_bias.restore(state.still_bias)
        self._attitude.restore(state.filter)


def build_pipeline(settings: Settings, *, calibration: ImuCalibration = UNCALIBRATED) -> Pipeline:
    """The pipeline of these settings; a bias in the settings goes before the calibration's."""
    if settings.start.gyro_bias_dps:
        x, y, z = (RAD_PER_DEG * dps for dps in settings.start.gyro_bias_dps)
        calibration = replace(calibration, gyro_bias_rad_s=(x, y, z))
    residual = Residual(
        tilt_rad=calibration.accel_sigma_m_s2 / STANDARD_GRAVITY_M_S2,
        gyro_bias_rad_s=calibration.gyro_bias_sigma_rad_s,
        gyro_bias_rad_s_degc=calibration.gyro_bias_sigma_rad_s_degc,
        gyro_scale=calibration.gyro_scale_sigma,
    )
    return Pipeline(
        Calibrate(calibration),
        StillBias(window_s=settings.start.still_s),
        PidFilter(settings.filter, residual=residual),
    )
