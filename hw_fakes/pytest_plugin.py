"""The pytest fixture `fake_mpu6050`: a fake chip under the driver that a test is about. It comes with quavelet.

    @pytest.mark.fake_mpu6050(motion=Still(pitch_deg=-20.0), perfect=True)
    def test_driver_reads_gravity_on_a_slope(fake_mpu6050):
        from mpu6050 import mpu6050  # mpu6050-raspberrypi of PyPI, which talks to /dev/i2c-1 by smbus
        sensor = mpu6050(0x68)
        fake_mpu6050.settle()
        assert list(sensor.get_accel_data().values()) == pytest.approx(fake_mpu6050.truth.force_m_s2, abs=0.001)

While the fixture is in use

- `smbus2.SMBus(1)` finds the chip and no other bus, a real one neither. A module `smbus` gives smbus2's SMBus, also
  where there is none; a driver that imports it is best imported within the test.
- Time is virtual, for the thread of the test: `time.sleep` returns at once and moves the chip's clock, and so does each
  transfer by its time on the wires. `time.time`, `monotonic`, `perf_counter` and their `_ns` follow that clock, from
  the real time on; looking at one takes a microsecond, so that waiting for a deadline comes to an end. Modules that
  took these functions by `from time import sleep` have the virtual ones too, but the standard library and pytest do
  not. Other threads, datetime and waiting for a lock stay in real time. What mixes the two, as asyncio does, would
  wait for ever: give it `real_time=True`, with which all is in real time, the chip too.

pytest loads this file in every session, so it imports nothing that is not loaded already.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

if TYPE_CHECKING:
    from hw_fakes import Adapter, FakeBus, FakeMpu6050, Faults, Motion, PatchedKernel
    from quavelet.core.clock import Clock

MARKER = (
    "fake_mpu6050(motion='still', perfect=False, faults='', board='', address=0x68, bus=1, real_time=False, **chip): "
    "what the fixture fake_mpu6050 is to be. motion: a Motion of hw_fakes, or the NAME of fake:NAME; perfect: no "
    "imperfection and no error of the clock but those given; faults: a plan, one fault a line, as 'nack p=0.01 "
    "seed=1'; board: a name of BOARDS, as 'gy-87', with its magnetometer; bus: the N of /dev/i2c-N; chip: further "
    "arguments of FakeMpu6050, as personality, imperfections, seed. What a nearer marker says goes before what a "
    "farther one says."
)
SETTLE_S = 0.5  # the slowest filter, and the gyroscope's error after waking
Triple = tuple[float, float, float]


class Truth(NamedTuple):
    """What a sensor without any error would show at one moment.

    attitude    body to world (ENU), Hamilton quaternion, scalar first
    rate_deg_s  x y z of the body
    force_m_s2  specific force, x y z of the body: (0, 0, 9.80665) where it lies level
    field_ut    magnetic field, x y z of the body
    temp_degc   of the die
    """

    attitude: tuple[float, float, float, float]
    rate_deg_s: Triple
    force_m_s2: Triple
    field_ut: Triple
    temp_degc: float


@dataclass(frozen=True, slots=True)
class Bench:
    """What the fixture is.

    chip     the fake, see `FakeMpu6050`
    bus      it as a bus object, for code that is given one
    adapter  the wires, to which more chips can be attached
    kernel   what smbus2 sees of it: errors to be met, and what was asked
    clock    the chip's: a VirtualClock, or with `real_time` a MonotonicClock
    """

    chip: FakeMpu6050
    bus: FakeBus
    kernel: PatchedKernel
    clock: Clock

    @property
    def adapter(self) -> Adapter:
        return self.bus.adapter

    @property
    def faults(self) -> Faults:
        """What goes wrong: faults by hand, and the history of all that did."""
        return self.adapter.faults

    def advance(self, seconds: float) -> None:
        """Let time pass."""
        self.clock.sleep_until_ns(self.clock.now_ns() + round(seconds * 1e9))

    def settle(self) -> None:
        """Let half a second pass, after which no filter remembers what was before."""
        self.advance(SETTLE_S)

    @property
    def truth(self) -> Truth:
        """Of this moment; what the chip shows is as old as its filter and sample make it.

        Raises ValueError for a chip that plays recorded counts, whose truth nobody knows.
        """
        import numpy as np

        motion = self.chip.motion
        if motion is None:
            raise ValueError("a chip that plays recorded counts has no truth: give it a motion")
        t_s = np.array([self.chip.world_time_s(self.clock.now_ns())])
        return Truth(
            attitude=tuple(motion.attitude(t_s)[0].tolist()),
            rate_deg_s=tuple(np.degrees(motion.rate_rad_s(t_s)[0]).tolist()),
            force_m_s2=tuple(motion.specific_force_m_s2(t_s)[0].tolist()),
            field_ut=tuple(motion.magnetic_field_ut(t_s)[0].tolist()),
            temp_degc=float(self.chip.imperfections.temperature_degc(t_s)[0]),
        )


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", MARKER)


@pytest.fixture
def fake_mpu6050(request: pytest.FixtureRequest) -> Iterator[Bench]:
    """A fake MPU-6050 under smbus2, in virtual time; `@pytest.mark.fake_mpu6050(...)` says what it does and is."""
    options: dict[str, Any] = {}
    for marker in request.node.iter_markers("fake_mpu6050"):  # the nearest first
        if marker.args:
            raise pytest.UsageError("the marker fake_mpu6050 takes arguments by name only, as motion='tilt'")
        options = {**marker.kwargs, **options}
    with bench(**options) as made:
        yield made


@contextmanager
def bench(
    *,
    motion: Motion | str = "still",
    perfect: bool = False,
    faults: str = "",
    board: str = "",
    address: int = 0x68,
    bus: int = 1,
    real_time: bool = False,
    **chip: Any,
) -> Iterator[Bench]:
    """What the fixture does, for a block. Raises SettingsError or ValueError for a name that is none."""
    from hw_fakes import PERFECT, FakeBus, FakeMpu6050, PatchedKernel, motion_named
    from hw_fakes import board as board_named
    from hw_fakes.faults.plan import parse_lines
    from hw_fakes.magnetometers.base import PERFECT_MAGNETOMETER, TYPICAL_MAGNETOMETER
    from hw_fakes.ways.virtual_time import virtual_time
    from quavelet.core.clock import MonotonicClock, VirtualClock

    clock: Clock = MonotonicClock() if real_time else VirtualClock()
    if isinstance(motion, str):
        motion = motion_named(motion)
    if perfect:
        chip = {"imperfections": PERFECT, "pll_error": 0.0, "internal_error": 0.0, **chip}
    if board:
        product, errors = board_named(board), PERFECT_MAGNETOMETER if perfect else TYPICAL_MAGNETOMETER
        master = product.aux_master(clock, motion, imperfections=errors)
        chip = {"personality": product.personality, "aux": master, **chip}
    the_chip = FakeMpu6050(clock, motion=None if "source" in chip else motion, **chip)
    the_bus = FakeBus({address: the_chip}, clock=clock, name="fake:bench")
    for at, target in (the_chip.aux.outside() if the_chip.aux else {}).items():
        the_bus.adapter.attach(at, target)
    for entry in parse_lines(faults):
        the_bus.adapter.faults.add(entry)
    kernel = PatchedKernel({f"/dev/i2c-{bus}": the_bus.adapter})
    with ExitStack() as stack:
        stack.enter_context(kernel.installed())
        stack.enter_context(_smbus_is_smbus2())
        if isinstance(clock, VirtualClock):
            stack.enter_context(virtual_time(clock))
        yield Bench(the_chip, the_bus, kernel, clock)


@contextmanager
def _smbus_is_smbus2() -> Iterator[None]:
    import smbus2

    from hw_fakes.ways.virtual_time import replaced

    if "smbus" in sys.modules:
        with replaced(sys.modules["smbus"], "SMBus", smbus2.SMBus):
            yield
        return
    sys.modules["smbus"] = smbus2
    try:
        yield
    finally:
        sys.modules.pop("smbus", None)
