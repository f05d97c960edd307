"""The long still run: whatever interrupts it, the minutes that were measured count."""

from __future__ import annotations

import numpy as np
import pytest
from session_rig import Bench

from quavelet.bench.session_result import work_out
from quavelet.bench.session_store import SessionStore
from quavelet.core.errors import DeviceLost

LOOKS_HZ = 6.0


def noise_dps_rthz(bench: Bench) -> list[float]:
    """The gyroscope's noise by what was measured."""
    result = work_out(bench.evidence, utc="2026-01-01T00:00:00Z", version="0")
    return [np.degrees(one.fit.density.value) for one in result.noise[:3]]


def lengths_s(bench: Bench) -> list[float]:
    return [run.lasts_s for run in bench.evidence.still]


@pytest.mark.parametrize("unplugged", [False, True])
def test_minutes_measured_before_an_interruption_are_not_measured_again(tmp_path, unplugged):
    out = tmp_path / "cal.toml"

    def pull(bench: Bench) -> None:
        if unplugged and bench.s > 130.0:
            bench.bus.chip.unplug()

    first = Bench(["allan"], out=out, each_look=pull)
    if unplugged:
        with pytest.raises(DeviceLost):
            first.conduct(looks_hz=LOOKS_HZ)
    else:
        assert not first.conduct(stopped=lambda: first.s > 130.0, looks_hz=LOOKS_HZ)
    kept = SessionStore(out).load(first.chip)
    assert [run.lasts_s for run in kept.still] == lengths_s(first)
    assert lengths_s(first)[0] == pytest.approx(120.0, abs=8.0)
    second = Bench(["allan"], out=out, evidence=kept)
    begun_s = second.s
    assert second.views == [] and second.session.step.progress == pytest.approx(0.4, abs=0.03)
    assert second.conduct(looks_hz=LOOKS_HZ)
    assert 170.0 < second.s - begun_s < 200.0
    assert sum(lengths_s(second)) == pytest.approx(300.0, abs=3.0)
    assert second.evidence.still[0] == kept.still[0]
    assert noise_dps_rthz(second) == pytest.approx([0.005] * 3, rel=0.1)


def test_a_bump_ends_a_stretch_and_is_in_none(tmp_path):
    due = [40.0, 150.0]

    def knock(bench: Bench) -> None:
        if due and bench.s > due[0]:
            due.pop(0)
            bench.bus.bump()

    bench = Bench(["allan"], out=tmp_path / "c", each_look=knock)
    assert bench.conduct(looks_hz=LOOKS_HZ)
    assert any(notice.endswith("; this stretch begins anew") for notice in bench.notices)
    assert any("was moved" in notice and "s before are kept" in notice for notice in bench.notices)
    # The first was too short to count.
    assert len(lengths_s(bench)) == 2
    assert min(lengths_s(bench)) > 60.0
    for run in bench.evidence.still:
        gyro, _ = run.si(bench.chip.scale)
        assert np.degrees(np.abs(gyro - gyro.mean(axis=0)).max()) < 1.0
    assert noise_dps_rthz(bench) == pytest.approx([0.005] * 3, rel=0.1)


def test_a_plug_pulled_for_a_moment_leaves_no_gap_in_a_stretch(tmp_path):
    def loose(bench: Bench) -> None:
        (bench.bus.chip.unplug if 100.0 < bench.s < 101.0 else bench.bus.chip.plug)()

    bench = Bench(["allan"], out=tmp_path / "c", each_look=loose)
    assert bench.conduct(looks_hz=LOOKS_HZ)
    assert any("samples were lost" in notice and "are kept" in notice for notice in bench.notices)
    assert len(lengths_s(bench)) == 2


def test_a_chip_that_is_too_hot_shows_no_noise(tmp_path):
    def heat(bench: Bench) -> None:
        if len(bench.views) == 60:
            at_s = bench.bus.chip.world_time_s(bench.clock.now_ns())
            bench.bus.sensor.goes_to(95.0, from_s=at_s, within_s=1.0)
            bench.bus.sensor.goes_to(40.0, from_s=at_s + 30.0, within_s=2.0)
            bench.bus.chip.recompute()

    bench = Bench(["allan"], out=tmp_path / "c", each_look=heat)
    assert bench.conduct(looks_hz=LOOKS_HZ)
    assert any("not specified beyond 85" in notice for notice in bench.notices)
    assert len(lengths_s(bench)) == 1
