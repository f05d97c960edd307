"""The stages in a row, built from settings: the same object live and offline."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from quavelet.attitude.doubt import Residual
from quavelet.attitude.first_fix import EARTH_UT
from quavelet.attitude.heading import HARD_IRON_SIGMA_MAX_UT, Heading, HeadingParams, HeadingState
from quavelet.attitude.params import FilterState
from quavelet.attitude.yaw_zero import YawZero, YawZeroState
from quavelet.calibration.calibrate import Calibrate
from quavelet.calibration.model import UNCALIBRATED, ImuCalibration
from quavelet.calibration.still_bias import StillBias, StillBiasState
from quavelet.core.blocks import AttitudeBlock, ImuBlock, RawBlock
from quavelet.core.flow import AttitudeFilter
from quavelet.core.mounting import AS_THE_CHIP, rotation
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2
from quavelet.denoise.stage import Denoise, DenoiseState
from quavelet.settings import Settings

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class PipelineState:
    """The memory of every stage."""

    still_bias: StillBiasState
    denoise: DenoiseState | None
    filter: FilterState
    heading: HeadingState | None
    yaw_zero: YawZeroState


class Pipeline:
    """`RawBlock` to `AttitudeBlock`: calibrate, take the bias at rest, denoise if asked to, filter, turn to
    north where there is a magnetometer, and count yaw from where it was set to zero by hand. A `Stage` itself.

    Denoising makes it late: samples come out `delay_ns` after they went in, and fewer of them at first.
    """

    def __init__(
        self,
        calibrate: Calibrate,
        still_bias: StillBias,
        denoise: Denoise | None,
        attitude: AttitudeFilter[FilterState],
        heading: Heading | None,
    ) -> None:
        self._calibrate = calibrate
        self._still_bias = still_bias
        self._denoise = denoise
        self._attitude = attitude
        self._heading = heading
        self.yaw_zero = YawZero()

    def process(self, block: RawBlock) -> AttitudeBlock:
        samples = self._still_bias.process(self._calibrate.process(block))
        if self._denoise is not None:
            samples = self._denoise.process(samples)
        attitude = self._attitude.process(samples)
        if self._heading is not None:
            attitude = self._heading.process(attitude, samples.field_ut)
        attitude = self.yaw_zero.process(attitude)
        return replace(attitude, delay_ns=self._denoise.delay_ns) if self._denoise is not None else attitude

    def zero_yaw(self) -> None:
        """The yaw of the last sample is zero from the next one on; for between two blocks. Raises NotPossible."""
        self.yaw_zero.zero()
        self._attitude.count_yaw_anew()

    def calibrated(self, block: RawBlock) -> ImuBlock:
        """The samples in SI, as they go into the other stages; nothing is remembered of them."""
        return self._calibrate.process(block)

    def state(self) -> PipelineState:
        denoise = self._denoise.state() if self._denoise else None
        heading = self._heading.state() if self._heading else None
        return PipelineState(self._still_bias.state(), denoise, self._attitude.state(), heading, self.yaw_zero.state())

    def restore(self, state: PipelineState) -> None:
        self._still_bias.restore(state.still_bias)
        if self._denoise is not None and state.denoise is not None:
            self._denoise.restore(state.denoise)
        self._attitude.restore(state.filter)
        if self._heading is not None and state.heading is not None:
            self._heading.restore(state.heading)
        self.yaw_zero.restore(state.yaw_zero)


def build_pipeline(settings: Settings, *, calibration: ImuCalibration = UNCALIBRATED) -> Pipeline:
    """The pipeline of these settings; a bias or a magnetometer's iron in the settings goes before the calibration's."""
    heading = heading_params(settings, calibration)
    if heading is None or settings.heading.calibrated:
        calibration = replace(calibration, magnetometer=None)
    if settings.start.gyro_bias_dps:
        x, y, z = (RAD_PER_DEG * dps for dps in settings.start.gyro_bias_dps)
        calibration = replace(calibration, gyro_bias_rad_s=(x, y, z), gyro_bias_curve=None)
    calibration = mounted(calibration, settings)
    residual = Residual(
        tilt_rad=calibration.accel_sigma_m_s2 / STANDARD_GRAVITY_M_S2,
        gyro_bias_rad_s=calibration.gyro_bias_sigma_rad_s,
        gyro_bias_rad_s_degc=calibration.gyro_bias_sigma_rad_s_degc,
        gyro_scale=calibration.gyro_scale_sigma,
    )
    row_filter = settings.denoise.build()
    return Pipeline(
        Calibrate(calibration),
        StillBias(window_s=settings.start.still_s, refine=calibration.knows_bias),
        Denoise(
            row_filter,
            sample_rate_hz=settings.chip.sample_rate_hz,
            keeps_slow_motion=settings.denoise.keeps_slow_motion,
        )
        if row_filter
        else None,
        settings.filter.build(residual=residual),
        Heading(heading, residual=residual) if heading else None,
    )


def mounted(calibration: ImuCalibration, settings: Settings) -> ImuCalibration:
    """A calibration of the chip, for the body it is mounted in."""
    axes = settings.mounting.axes
    return calibration if axes == AS_THE_CHIP else calibration.turned(rotation(axes))


def mounted_heading(settings: Settings) -> HeadingParams:
    """The magnetometer's calibration, which is in the chip's axes, for the body it is mounted in."""
    heading, axes = settings.heading, settings.mounting.axes
    if axes == AS_THE_CHIP:
        return heading
    soft_iron = np.array(rotation(axes)) @ np.array(heading.soft_iron or np.eye(3)).reshape(3, 3)
    return msgspec.structs.replace(heading, soft_iron=tuple(soft_iron.ravel().tolist()))


def heading_params(settings: Settings, calibration: ImuCalibration) -> HeadingParams | None:
    """What heading is found by, None without a magnetometer or where that is not calibrated.

    Those of the settings, where they hold a calibration; else the field comes calibrated already.
    """
    magnetometer = calibration.magnetometer
    if not settings.magnetometer.used:
        return None
    if settings.heading.calibrated or magnetometer is None:
        return mounted_heading(settings) if settings.heading.calibrated else None
    return msgspec.structs.replace(
        settings.heading,
        hard_iron_ut=(0.0, 0.0, 0.0),
        hard_iron_sigma_ut=min(magnetometer.left_ut, HARD_IRON_SIGMA_MAX_UT),
        soft_iron=(),
        field_ut=min(max(magnetometer.field_ut, EARTH_UT[0]), EARTH_UT[1]),
    )


def tell_uncalibrated_magnetometer(settings: Settings, calibration: ImuCalibration) -> None:
    """A warning where there is a magnetometer that gives no heading."""
    if settings.magnetometer.used and heading_params(settings, calibration) is None:
        log.warning(
            "the magnetometer is not calibrated, and yaw stays relative: take `quavelet calibrate --steps "
            "magnetometer`, or give heading.hard_iron_ut"
        )
