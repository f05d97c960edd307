"""What is set side by side: the default, the papers' methods, and the settings given where they are others."""

from __future__ import annotations

from quavelet.attitude.params import FilterParams
from quavelet.denoise.params import DenoiseParams
from quavelet.settings import Settings, StartSettings
from quavelet.study.methods import DEFAULT, methods


def test_the_default_comes_first_and_is_what_runs_by_itself():
    first, *others = methods(Settings())
    assert (first.name, first.settings) == (DEFAULT, Settings())
    assert "as set" not in [method.name for method in others]
    assert len({method.name for method in others}) == len(others) == 6


def test_other_settings_than_the_default_are_a_method_of_their_own():
    set_by_hand = Settings(filter=FilterParams(kind="pid", kp=2.0), denoise=DenoiseParams(kind="median"))
    found = {method.name: method.settings for method in methods(set_by_hand)}
    assert found["as set"] == set_by_hand
    assert found[DEFAULT] == Settings()


def test_what_is_no_filter_is_the_same_for_all():
    start = StartSettings(still_s=5.0)
    assert {method.settings.start for method in methods(Settings(start=start))} == {start}


def test_only_the_wavelet_method_is_denoised_and_only_the_accelerometer_has_no_heading():
    found = methods(Settings())
    assert [method.name for method in found if method.settings.denoise.kind != "none"] == ["wavelet PID"]
    assert [method.name for method in found if not method.has_heading] == ["accelerometer"]
