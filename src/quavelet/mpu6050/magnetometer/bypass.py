"""Reading a magnetometer by the bypass: the host speaks with it as if it were on the outer bus."""

from __future__ import annotations

from quavelet.core.clock import Clock
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.magnetometer.aux_registers import open_bypass
from quavelet.mpu6050.magnetometer.identify import FoundMagnetometer
from quavelet.mpu6050.magnetometer.plan import MagnetometerConfig, Plan
from quavelet.mpu6050.magnetometer.reader import Reader
from quavelet.mpu6050.magnetometer.samples import MagSample


class BypassReader(Reader):
    """A magnetometer that is read each time it is asked for.

    Every method raises BusError (DeviceMissing where it does not answer, as after a reset of the chip, which closes the
    bypass); `read` also DeviceLost and ChipUnstable where it answers and does not measure as it was told. After each of
    them `set_up` brings all back.
    """

    def set_up(self) -> None:
        """Open the bypass, switch the chip's master off, and let the magnetometer measure; takes up to 20 ms.

        Raises SettingsError where it cannot measure as asked, and ChipUnstable where it does not give its factory's
        adjustment.
        """
        if not self._found.outside:
            open_bypass(self._chip)
        self._plan = prepared(self._target, self._found, self._config, clock=self._clock)
        self._sampler = self._new_sampler(self._plan)
        self._begun_ns = 0
        self._trigger()

    def read(self) -> MagSample:
        """What the magnetometer shows; `new` is False where it has measured nothing since the last look.

        A single measurement is of the time after the last look at which it could begin, however long ago that is: who
        looks seldom gets old ones, and `t_ns` says so.
        """
        plan, sampler = self._plan, self._sampler
        if plan is None or sampler is None:
            raise ValueError("the magnetometer is not set up: call set_up first")
        block = b"".join(self._target.read_run(run.register, run.n) for run in plan.runs)
        now_ns = self._clock.now_ns()
        t_ns = min(now_ns, self._begun_ns + plan.measuring_ns) if plan.trigger else now_ns
        sample = sampler.take_read(block, t_ns, now_ns=now_ns)
        if now_ns - self._begun_ns >= self._pause_ns(plan):
            self._trigger()
        return sample

    @staticmethod
    def _pause_ns(plan: Plan) -> int:
        """Between the beginnings of two single measurements; by then the one before has ended and has been read."""
        return max(plan.measuring_ns, round(NS_PER_S / plan.rate_hz))

    def _trigger(self) -> None:
        if self._plan and self._plan.trigger:
            self._target.write(self._plan.trigger.register, self._plan.trigger.byte)
            self._begun_ns = self._clock.now_ns()


def prepared(target: RegisterAccess, found: FoundMagnetometer, config: MagnetometerConfig, *, clock: Clock) -> Plan:
    """Set the magnetometer up, which must be reachable; the plan that was made for it. Raises as `BypassReader`."""
    plan = found.kind.plan(config, target, clock=clock)
    for write in plan.set_up:
        target.write(write.register, write.byte)
        if write.wait_ns:
            clock.sleep_until_ns(clock.now_ns() + write.wait_ns)
    return plan
