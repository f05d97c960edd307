"""The figures that are promised; `pytest -s` prints them."""

from __future__ import annotations

import numpy as np
import pytest
from chip_rig import Rig, check_honest, config

from hw_fakes import NOISE_ONLY, Turntable
from quavelet.core.blocks import concat
from quavelet.core.units import NS_PER_S
from quavelet.pipeline import build_pipeline
from quavelet.settings import Settings


@pytest.mark.parametrize(("rate_hz", "loop_hz"), [(200.0, 100.0), (1000.0, 200.0), (50.0, 100.0)])
def test_oscillator_3_percent_fast_is_known_within_1_in_1000_after_30_s(rate_hz, loop_hz):
    rig = Rig(config(rate_hz), pll_error=0.03).start()
    errors = []
    for _ in range(6):
        rig.run(5.0, every_ms=1000 / loop_hz)
        assert rig.source.decoder is not None and rig.source.decoder.measured_rate_hz is not None
        errors.append(rig.source.decoder.measured_rate_hz / rig.chip.true_rate_hz() - 1)
    text = ", ".join(f"{1e6 * error:+.0f}" for error in errors)
    print(f"\n{rate_hz:g} Hz drained at {loop_hz:g} Hz: rate error in ppm after 5, 10, ... 30 s: {text}")
    assert abs(errors[0]) < 3e-3
    assert abs(errors[-1]) < 1e-3


@pytest.mark.parametrize("pll_error", [0.03, -0.03])
def test_turn_of_360_degrees_is_360_degrees_although_the_oscillator_is_off(pll_error):
    """By the nominal period it would be 349 or 371."""
    table = Turntable(start_s=5.0)
    settings = Settings()
    rig = Rig(settings.chip, motion=table, imperfections=NOISE_ONLY, pll_error=pll_error).start()
    pipeline = build_pipeline(settings)
    rig.run(table.stop_s + 2.0, every_ms=1000 / settings.loop.rate_hz)
    attitude = concat([pipeline.process(block) for block in rig.blocks])
    w, x, y, z = attitude.q.T
    yaw_deg = np.degrees(np.unwrap(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2))))
    turn_deg = yaw_deg[-1] - yaw_deg[0]
    true_s = (attitude.t_ns - rig.chip.birth_ns) / NS_PER_S
    wrong_deg = yaw_deg - yaw_deg[0] - np.degrees(table.angle_rad(true_s)[0])
    print(f"\noscillator {pll_error:+.0%}: the turn is {turn_deg:.3f} deg, at worst {np.abs(wrong_deg).max():.2f} off")
    assert turn_deg == pytest.approx(360.0, abs=0.5)
    # On the way the low-pass filter's 5 ms at 30 deg/s come on top.
    assert np.abs(wrong_deg).max() < 0.75


@pytest.mark.parametrize("loop_hz", [100, 200])
def test_1_khz_for_a_minute_at_400_khz_loses_no_sample_and_leaves_room_on_the_bus(loop_hz):
    rig = Rig(config(1000.0, dlpf=1)).start()
    busy_ns, begin_ns = rig.fake_bus.busy_ns, rig.clock.now_ns()
    rig.run(60.0, every_ms=1000 / loop_hz)
    busy = (rig.fake_bus.busy_ns - busy_ns) / (rig.clock.now_ns() - begin_ns)
    numbers = check_honest(rig)
    rig.fake_bus.write_read(0x68, b"\x75", 1)  # the fake looks at its clock
    waiting = len(rig.chip.fifo) // 14
    print(f"\n1 kHz, loop {loop_hz} Hz: {len(numbers)} samples, {waiting} waiting, bus busy {busy:.1%}")
    assert (np.diff(numbers) == 1).all()
    assert rig.health.samples == len(numbers) == rig.taken_now() - numbers[0] - waiting
    assert len(numbers) > 60_000
    assert rig.health.samples_lost == rig.health.fifo_resets == 0
    assert busy <= 0.40
