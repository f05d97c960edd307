"""Allan deviation against allantools, and noise figures against noise that was made with known ones."""

from __future__ import annotations

import allantools
import numpy as np
import pytest

from quavelet.calibration.allan import ACCEL, GYRO, allan_deviation, allan_deviation_of, fit_noise
from quavelet.core.units import STANDARD_GRAVITY_M_S2

PERIOD_S = 0.01
STILL_655_S = "sunsided_set-2_unmoved-with-x-pointing-forward-10min.npz"


def white(n: int, density: float, *, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, density * np.sqrt(0.5 / PERIOD_S), n)


def walk(n: int, per_sqrt_s: float, *, seed: int = 2) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).normal(0.0, per_sqrt_s * np.sqrt(PERIOD_S), n))


def flicker(n: int, instability: float, *, seed: int = 3) -> np.ndarray:
    """Noise of one-sided spectral density instability^2 / (pi f): sqrt(2 ln 2 / pi) of it is the flat part."""
    frequency = np.fft.rfftfreq(n, PERIOD_S)
    rng = np.random.default_rng(seed)
    lines = rng.normal(size=len(frequency)) + 1j * rng.normal(size=len(frequency))
    density = np.divide(instability**2 / np.pi, frequency, out=np.zeros_like(frequency), where=frequency > 0)
    return np.fft.irfft(lines * np.sqrt(density / PERIOD_S * n / 4.0), n)


@pytest.mark.parametrize("values", [white(5000, 1.0), walk(5001, 1.0), 1e3 + white(4000, 0.1) + walk(4000, 0.3)])
def test_every_point_is_the_one_allantools_gives(values):
    curve = allan_deviation(values, period_s=PERIOD_S)
    tau, theirs, _, _ = allantools.oadev(values, rate=1 / PERIOD_S, data_type="freq", taus=curve.tau_s)
    assert curve.tau_s == pytest.approx(tau)
    assert curve.deviation == pytest.approx(theirs, rel=1e-6)
    assert len(curve.tau_s) > 20
    assert curve.tau_s[-1] == pytest.approx(len(values) * PERIOD_S / 4, rel=1e-3)


def test_white_noise_of_a_known_density_has_that_density_and_nothing_else():
    fit = fit_noise(allan_deviation(white(60_000, 0.02), period_s=PERIOD_S))
    assert fit.density.value == pytest.approx(0.02, rel=0.03)
    assert abs(fit.density.value - 0.02) < 3 * fit.density.sigma
    for term in (fit.instability, fit.walk, fit.ramp):
        assert not term.seen
        assert term.limit > 0


def test_the_three_noises_are_told_apart_where_the_record_shows_them():
    n = 200_000
    values = white(n, 0.02) + flicker(n, 0.02) + walk(n, 0.002)
    fit = fit_noise(allan_deviation(values, period_s=PERIOD_S))
    assert fit.density.value == pytest.approx(0.02, rel=0.05)
    assert fit.instability.value == pytest.approx(0.02, rel=0.25)
    assert fit.walk.value == pytest.approx(0.002, rel=0.4)
    assert fit.density.seen
    assert fit.instability.seen


def test_the_flat_part_of_flicker_noise_is_0_664_of_the_instability():
    curve = allan_deviation(flicker(100_000, 1.0), period_s=PERIOD_S)
    flat = curve.deviation[(curve.tau_s > 1) & (curve.tau_s < 20)]
    assert flat == pytest.approx(0.664, rel=0.2)


def test_a_steady_drift_is_a_ramp_and_no_noise():
    n = 60_000
    fit = fit_noise(allan_deviation(white(n, 0.02) + 1e-3 * PERIOD_S * np.arange(n), period_s=PERIOD_S))
    assert fit.ramp.value == pytest.approx(1e-3, rel=0.05)
    assert fit.density.value == pytest.approx(0.02, rel=0.03)
    assert not fit.walk.seen


def test_the_bounds_hold_the_truth_as_often_as_they_say():
    inside = []
    for seed in range(60):
        curve = allan_deviation(white(2000, 1.0, seed=seed), period_s=PERIOD_S)
        low, high = curve.bounds()
        inside.append((low < 1 / np.sqrt(2 * curve.tau_s)) & (1 / np.sqrt(2 * curve.tau_s) < high))
    assert np.mean(inside, axis=0).min() > 0.8
    assert 0.9 < np.mean(inside) < 1.0


def test_the_density_is_as_sure_as_it_says():
    misses = []
    for seed in range(40):
        density = fit_noise(allan_deviation(white(6000, 0.01, seed=seed), period_s=PERIOD_S)).density
        misses.append((density.value - 0.01) / density.sigma)
    assert 0.3 < np.std(misses) < 2.0


def test_the_fit_describes_the_curve():
    values = white(60_000, 0.02) + walk(60_000, 0.004)
    curve = allan_deviation(values, period_s=PERIOD_S)
    sure = curve.relative_sigma < 0.1
    assert fit_noise(curve).deviation(curve.tau_s)[sure] == pytest.approx(curve.deviation[sure], rel=0.25)


def test_the_minimum_is_where_longer_averages_stop_helping():
    deviation, tau_s = allan_deviation(white(60_000, 0.02) + walk(60_000, 0.004), period_s=PERIOD_S).minimum()
    assert deviation == pytest.approx(np.sqrt(0.02 * 0.004 * np.sqrt(2 / 3)), rel=0.3)
    assert tau_s == pytest.approx(0.02 / 0.004 * np.sqrt(1.5), rel=0.8)


@pytest.mark.parametrize(("times", "word"), [(0.9, "good"), (3.0, "usual"), (6.0, "poor")])
@pytest.mark.parametrize("sheet", [GYRO, ACCEL], ids=lambda sheet: sheet.name)
def test_the_word_goes_by_the_data_sheet(sheet, times, word):
    assert sheet.word(times * sheet.density * sheet.unit_si) == word


def test_the_data_sheets_units_in_si():
    assert GYRO.density * GYRO.unit_si == pytest.approx(np.radians(0.005))
    assert ACCEL.density * ACCEL.unit_si == pytest.approx(400e-6 * STANDARD_GRAVITY_M_S2)


@pytest.mark.parametrize(
    ("values", "tau_s", "complaint"),
    [
        (np.zeros(63), None, "too few"),
        (np.zeros((64, 3)), None, "too few"),
        (np.array([0.0] * 63 + [np.nan]), None, "not finite"),
        (np.zeros(100), np.array([0.001]), "averaging times go from"),
        (np.zeros(100), np.array([0.6]), "averaging times go from"),
    ],
)
def test_what_has_no_allan_deviation_is_refused(values, tau_s, complaint):
    with pytest.raises(ValueError, match=complaint):
        allan_deviation(values, period_s=PERIOD_S, tau_s=tau_s)


@pytest.mark.parametrize("values", [white(100, 1.0), np.zeros(5000)], ids=["a second", "frozen"])
def test_a_record_that_shows_no_noise_has_no_figures(values):
    with pytest.raises(ValueError, match="ten seconds or more"):
        fit_noise(allan_deviation(values, period_s=PERIOD_S))


def test_a_real_chip_that_lay_still_for_eleven_minutes(recordings, capsys):
    file = dict(np.load(recordings / STILL_655_S))
    period_s = 1.0 / float(file["rate"])
    gyro = np.radians(file["gyr"] / float(file["gyr_lsb_per_dps"]))
    curves = [allan_deviation(gyro[:, k], period_s=period_s) for k in range(3)]
    fits = [fit_noise(curve) for curve in curves]
    densities = [fit.density.value / GYRO.unit_si for fit in fits]
    with capsys.disabled():
        print(
            "\n655 s still, gyroscope: "
            + "; ".join(
                f"{density:.4f} deg/s/rtHz ({GYRO.word(fit.density.value)}), least deviation "
                f"{curve.minimum()[0] / GYRO.unit_si:.4f} deg/s at {curve.minimum()[1]:.0f} s"
                for density, fit, curve in zip(densities, fits, curves, strict=True)
            )
        )
    assert densities == pytest.approx([0.0176, 0.0126, 0.0134], rel=0.05)
    assert [curve.minimum()[0] / GYRO.unit_si for curve in curves] == pytest.approx([0.0028, 0.0014, 0.0006], abs=1e-4)
    for k, curve in enumerate(curves):
        _, theirs, _, _ = allantools.oadev(gyro[:, k], rate=1 / period_s, data_type="freq", taus=curve.tau_s)
        assert curve.deviation == pytest.approx(theirs, rel=0.01)


def test_stretches_with_a_gap_between_are_averaged_at_each_tau_and_surer_together():
    first, second = white(6000, 0.02, seed=5) + 3.0, white(3000, 0.02, seed=6) - 1.0
    together = allan_deviation_of([first, second], period_s=PERIOD_S)
    alone = allan_deviation(first, period_s=PERIOD_S)
    assert together.tau_s == pytest.approx(alone.tau_s)
    for tau, deviation in zip(together.tau_s, together.deviation, strict=True):
        each = []
        for values in (first, second):
            m = round(tau / PERIOD_S)
            if m <= len(values) // 4:
                _, theirs, _, _ = allantools.oadev(values, rate=1 / PERIOD_S, data_type="freq", taus=[tau])
                each.append(theirs[0])
        assert min(each) * (1 - 1e-6) <= deviation <= max(each) * (1 + 1e-6)
    short = together.tau_s < 5.0
    assert (together.relative_sigma[short] < 0.9 * alone.relative_sigma[short]).all()
    assert together.relative_sigma[-1] == pytest.approx(alone.relative_sigma[-1])


def test_one_stretch_is_what_it_is_alone():
    values = white(5000, 1.0)
    one, alone = allan_deviation_of([values], period_s=PERIOD_S), allan_deviation(values, period_s=PERIOD_S)
    assert one.deviation == pytest.approx(alone.deviation)
    assert one.relative_sigma == pytest.approx(alone.relative_sigma)
