"""What can be tuned of the fusion filter."""

from __future__ import annotations

from math import sqrt
from typing import Literal

import msgspec

from quavelet.core.errors import SettingsError
from quavelet.core.units import RAD_PER_DEG
from quavelet.core.units import STANDARD_GRAVITY_M_S2 as G


class FusionParams(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Densities are one-sided, as data sheets give them. "Moving" holds whenever stillness is not certain, and takes
    in what no data sheet has. The defaults did best over recorded hand motion and a robot arm with measured truth.

    model                 "velocity" (default) or "gravity", the paper's
    gyro_rad_s_rthz       of the rate while moving
    gyro_share_rthz       model velocity: what comes to it, as a share of the rate: errors of scale and alignment
    gyro_still_rad_s_rthz of the rate at rest
    accel_m_s2_rthz       of the accelerometer
    sway_m_s2_rthz        model gravity: of the specific force while moving
    velocity_m_s_rthz     model velocity: of the velocity while moving
    rest_m_s_rthz         model velocity: of the velocity at rest
    norm_gate             model gravity: variance grows by 1 + ((|f|/g - 1)/gate)^4, 0: never. The gate keeps the
                          samples that happen to have 1 g, and their mean is not up
    bias_rad_s            a bias that is said to be known is trusted no more than this
    bias_walk_rad_s_rts   growth of the bias' sigma per root of time
    memory_s              old measurements fade with this time constant (the paper's lambda is exp(-T/memory_s))
    """

    model: Literal["velocity", "gravity"] = "velocity"
    gyro_rad_s_rthz: float = 0.05 * RAD_PER_DEG
    gyro_share_rthz: float = 0.003
    gyro_still_rad_s_rthz: float = 0.02 * RAD_PER_DEG
    accel_m_s2_rthz: float = 400e-6 * G
    sway_m_s2_rthz: float = 0.004 * G
    velocity_m_s_rthz: float = 0.3
    rest_m_s_rthz: float = 0.01
    norm_gate: float = 0.0
    bias_rad_s: float = 0.05 * RAD_PER_DEG
    bias_walk_rad_s_rts: float = 0.003 * RAD_PER_DEG * sqrt(2.0 / 100.0)
    memory_s: float = 100.0

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            value = getattr(self, name)
            if name == "model":
                continue
            zero_allowed = name in ("gyro_share_rthz", "norm_gate", "bias_rad_s", "bias_walk_rad_s_rts")
            if not (1e-9 <= value <= 1e6 or (zero_allowed and value == 0.0)):  # NaN is refused too
                raise SettingsError(f"{name} = {value} does not fit: give a number above 0, to 1e6")
