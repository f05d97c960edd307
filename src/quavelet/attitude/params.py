"""The settings of the attitude filter, and the filter they ask for."""

from __future__ import annotations

from typing import Literal, cast

import msgspec

from quavelet.attitude.doubt import Residual
from quavelet.attitude.fusion import FusionFilter, FusionState
from quavelet.attitude.fusion_literal import LiteralFusionFilter, LiteralParams, LiteralState
from quavelet.attitude.fusion_params import FusionParams
from quavelet.attitude.gated import GatedFilter, GatedState
from quavelet.attitude.kernel import Method
from quavelet.attitude.levels import AccelerometerFilter, AccelerometerState
from quavelet.attitude.pid import PidFilter, PidParams, PidState
from quavelet.core.errors import SettingsError
from quavelet.core.flow import AttitudeFilter

Kind = Literal["gated", "velocity", "pid", "p", "gyro", "accelerometer", "fusion", "fusion-literal"]
FilterState = GatedState | PidState | AccelerometerState | FusionState | LiteralState

_GAINS = ("kp", "ki", "kd", "kd_tau_s", "integral_limit_rad_s")
_USES: dict[Kind, tuple[str, ...]] = {
    "gated": ("tau_s", "relearn_s"),
    "velocity": ("tau_s",),
    "pid": _GAINS,
    "p": ("kp",),
    "gyro": (),
    "accelerometer": (),
    "fusion": (),
    "fusion-literal": (),
}


class FilterParams(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which filter, and what can be tuned of it. A value that is not the default's and that the kind has no use for is
    an error.

    kind        "gated"          holds still when the board does, and is "velocity" else
                "velocity"       a Kalman filter that knows the board's velocity to stay near zero
                "pid", "p"       paper 000's methods 4 and 3, with wavelets in [denoise] its method 5
                "gyro"           its method 2: the rate integrated, gravity is never asked after the start
                "accelerometer"  its method 1: the tilt of each sample by itself, no heading
                "fusion"         paper 003's quaternion fusion in the form that is stable
                "fusion-literal" the same as written: unstable, for comparison only
    tau_s       of "gated" and "velocity": how slowly gravity corrects a tilt while the board moves; longer where it
                moves harder
    relearn_s   of "gated": a small rate as steady for so long is taken for the bias during the first five minutes
                and while the chip's temperature changes; 0: never, the heading is flagged only
    kp          of "pid" and "p", 1/s: how strongly gravity corrects the tilt; more drifts less, and is disturbed more
                by acceleration
    ki          of "pid", 1/s^2: the same for the integral, which follows the gyroscope's bias while the board moves
    kd          of "pid": the same for the derivative, low-passed over kd_tau_s seconds
    kd_tau_s    of "pid"
    integral_limit_rad_s   of "pid": no axis of the integral goes beyond this
    method      how the rate is integrated
    """

    kind: Kind = "gated"
    tau_s: float = 4.0
    relearn_s: float = 0.0
    kp: float = 0.3
    ki: float = 0.005
    kd: float = 0.0
    kd_tau_s: float = 0.5
    integral_limit_rad_s: float = 0.05
    method: Method = "rk4"

    def __post_init__(self) -> None:
        if not 0.5 <= self.tau_s <= 60.0:
            raise SettingsError(f"tau_s = {self.tau_s} does not fit: give 0.5 to 60 s")
        if not (self.relearn_s == 0.0 or 5.0 <= self.relearn_s <= 300.0):
            raise SettingsError(f"relearn_s = {self.relearn_s} does not fit: give 5 to 300 s, or 0 for never")
        self.gains()
        for field in msgspec.structs.fields(FilterParams):
            if field.name in ("kind", "method", *_USES[self.kind]) or getattr(self, field.name) == field.default:
                continue
            users = " or ".join(f'"{kind}"' for kind, names in _USES.items() if field.name in names)
            raise SettingsError(
                f'{field.name} is of no use to kind = "{self.kind}": leave it out, or take kind {users}'
            )

    def gains(self) -> PidParams:
        """The gains of "pid", "p" or "gyro"; raises SettingsError for one that is none."""
        pid = PidParams(
            kp=self.kp,
            ki=self.ki,
            kd=self.kd,
            kd_tau_s=self.kd_tau_s,
            integral_limit_rad_s=self.integral_limit_rad_s,
            method=self.method,
        )
        if self.kind == "p":
            return msgspec.structs.replace(pid, ki=0.0, kd=0.0)
        if self.kind == "gyro":
            return msgspec.structs.replace(pid, kp=0.0, ki=0.0, kd=0.0)
        return pid

    def build(self, *, residual: Residual) -> AttitudeFilter[FilterState]:
        """A new filter; `residual` is what the calibration leaves open. Its state fits a filter of the same kind."""
        return cast("AttitudeFilter[FilterState]", self._build(residual))

    def _build(
        self, residual: Residual
    ) -> GatedFilter | PidFilter | AccelerometerFilter | FusionFilter | LiteralFusionFilter:
        if self.kind == "fusion":
            return FusionFilter(FusionParams(), residual=residual)
        if self.kind == "fusion-literal":
            return LiteralFusionFilter(LiteralParams(), residual=residual)
        if self.kind == "accelerometer":
            return AccelerometerFilter(residual=residual)
        if self.kind in ("gated", "velocity"):
            return GatedFilter(
                residual=residual,
                tau_s=self.tau_s,
                relearn_s=self.relearn_s,
                gate=self.kind == "gated",
                method=self.method,
            )
        return PidFilter(self.gains(), residual=residual)
