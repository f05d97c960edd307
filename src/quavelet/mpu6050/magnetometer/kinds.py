"""The magnetometers this driver knows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from quavelet.core.clock import Clock
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.magnetometer import akm, hmc5883l, qmc5883l
from quavelet.mpu6050.magnetometer.plan import MagnetometerConfig, Plan

Adjustment = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of magnetometer and what can be asked of it.

    ranges_ut   full scales of an axis, uT
    rates_hz    measurements a second; where `any_rate`, all up to this one
    """

    name: str
    address: int
    ranges_ut: tuple[float, ...]
    rates_hz: tuple[float, ...]
    make_plan: Callable[[MagnetometerConfig, Adjustment | None], Plan]
    any_rate: bool = False
    has_adjustment: bool = False

    def plan(self, config: MagnetometerConfig, target: RegisterAccess, *, clock: Clock) -> Plan:
        """What to do with the chip that `target` reaches. Raises SettingsError, and BusError where the factory's
        adjustment is to be read and the bypass is closed."""
        return self.make_plan(config, akm.read_adjustment(target, clock=clock) if self.has_adjustment else None)

    def sensible_config(self) -> MagnetometerConfig:
        """A rate that keeps up with a hand, and the range that fits the Earth's field with a magnet not far."""
        rate_hz = next(rate for rate in self.rates_hz if rate >= 50.0)
        return MagnetometerConfig(rate_hz=rate_hz, range_ut=next(u for u in self.ranges_ut if u >= 190.0))


_ALL = (
    Kind(
        hmc5883l.NAME,
        hmc5883l.ADDRESS,
        hmc5883l.RANGES_UT,
        (hmc5883l.FASTEST_HZ,),
        hmc5883l.plan,
        any_rate=True,
    ),
    Kind(qmc5883l.NAME, qmc5883l.ADDRESS, qmc5883l.RANGES_UT, qmc5883l.RATES_HZ, qmc5883l.plan),
    Kind(
        akm.AK8963,
        akm.ADDRESS,
        akm.RANGES_8963_UT,
        akm.RATES_8963_HZ,
        akm.plan_ak8963,
        has_adjustment=True,
    ),
    Kind(
        akm.AK8975,
        akm.ADDRESS,
        akm.RANGES_8975_UT,
        (akm.FASTEST_8975_HZ,),
        akm.plan_ak8975,
        any_rate=True,
        has_adjustment=True,
    ),
)
KINDS: dict[str, Kind] = {kind.name: kind for kind in _ALL}
