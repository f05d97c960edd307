"""What `ChipConfig` refuses, and what it says then."""

from __future__ import annotations

import re

import pytest
from chip_rig import config
from hypothesis import example, given
from hypothesis import strategies as st

from quavelet.core.errors import SettingsError

NOT_RATES = [float("nan"), float("inf"), float("-inf"), 0.0, -0.0, -200.0, 1e-300]


@pytest.mark.parametrize("rate_hz", [*NOT_RATES, 1000.1, 1001, 8000, 3.9, 3.0])
def test_rate_the_chip_cannot_have_is_refused(rate_hz):
    with pytest.raises(SettingsError, match="sample_rate_hz"):
        config(rate_hz)


@pytest.mark.parametrize("rate_hz", [*NOT_RATES, 2000, 8000, 31.2])
def test_rate_the_chip_cannot_have_without_low_pass_is_refused(rate_hz):
    with pytest.raises(SettingsError, match="sample_rate_hz"):
        config(rate_hz, dlpf=0)


@pytest.mark.parametrize(("dlpf", "base"), [(0, 8000), (1, 1000), (6, 1000)])
def test_slowest_rate_is_the_base_divided_by_256(dlpf, base):
    assert config(base / 256, dlpf=dlpf).divider == 255
    with pytest.raises(SettingsError, match=r"too slow"):
        config(base / 257, dlpf=dlpf)


@given(dlpf=st.integers(0, 6), rate_hz=st.floats(3.90625, 1000.0))
@example(dlpf=3, rate_hz=166.667)
@example(dlpf=3, rate_hz=142.857)
@example(dlpf=3, rate_hz=999.0)
@example(dlpf=0, rate_hz=999.0)
@example(dlpf=3, rate_hz=3.91)
def test_refused_rate_names_the_two_nearest_and_these_are_accepted(dlpf, rate_hz):
    """An error that proposes 166.667 and then refuses it sends its reader round in circles."""
    try:
        config(rate_hz, dlpf=dlpf)
    except SettingsError as error:
        found = re.search(r"nearest are (\S+) and (\S+)$", str(error))
        if found is None:
            assert dlpf == 0 and rate_hz < 31.25 and "too slow" in str(error)
            return
        below, above = (float(text) for text in found.groups())
        assert below < rate_hz < above
        dividers = [config(rate, dlpf=dlpf).divider for rate in (below, above)]
        assert dividers[0] == dividers[1] + 1


@given(n=st.integers(1, 256), digits=st.integers(6, 15))
def test_rate_written_with_six_digits_is_that_of_the_whole_divider(n, digits):
    assert config(float(f"{1000 / n:.{digits}g}")).divider == n - 1


@pytest.mark.parametrize("dlpf", [7, -1, 8, 3.5])
def test_reserved_low_pass_is_refused(dlpf):
    with pytest.raises(SettingsError, match=r"dlpf = .* 0, 1, 2, 3, 4, 5, 6"):
        config(dlpf=dlpf)


@pytest.mark.parametrize("gyro", [0, 245, 499, 2001, -250])
def test_gyroscope_range_the_chip_has_not_is_refused(gyro):
    with pytest.raises(SettingsError, match=r"gyro_range_dps = .* 250, 500, 1000, 2000"):
        config(gyro=gyro)


@pytest.mark.parametrize("accel", [0, 1, 3, 6, 32, -2])
def test_accelerometer_range_the_chip_has_not_is_refused(accel):
    with pytest.raises(SettingsError, match=r"accel_range_g = .* 2, 4, 8, 16"):
        config(accel=accel)


# Bandwidths of the gyroscope by DLPF_CFG (register 26).
@pytest.mark.parametrize(
    ("dlpf", "rate_hz", "warns"),
    [
        (0, 1000, False), (0, 500, True), (1, 1000, False), (1, 250, True), (2, 200, False), (2, 100, True),
        (3, 100, False), (3, 50, True), (4, 40, False), (5, 20, False), (5, 10, True), (6, 10, False), (6, 5, True),
    ],
)  # fmt: skip
def test_bandwidth_above_half_the_rate_warns_of_folding(dlpf, rate_hz, warns):
    warnings = config(rate_hz, dlpf=dlpf).warnings()
    assert bool(warnings) == warns
    assert all("fold" in text and f"dlpf = {dlpf}" in text for text in warnings)
