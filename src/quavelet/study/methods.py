"""The methods that are set side by side: the papers' and the one that is the default, each a filter's settings."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

from quavelet.attitude.params import FilterParams
from quavelet.denoise.params import DenoiseParams
from quavelet.settings import Settings

DEFAULT = "default"
PAPER_PID = FilterParams(kind="pid", kp=1.0, ki=0.02, kd=0.5)
PAPER_WAVELET = DenoiseParams(kind="wavelet", wavelet="db3", levels=2)


@dataclass(frozen=True, slots=True)
class Method:
    """A name for the legend, what it is, and the settings it runs with."""

    name: str
    what: str
    settings: Settings

    @property
    def has_heading(self) -> bool:
        """Does it follow turns about the vertical?"""
        return self.settings.filter.kind != "accelerometer"


def methods(base: Settings) -> tuple[Method, ...]:
    """All methods with everything but filter and denoising as in `base`; first the default, and where `base` has
    others than that, then those."""
    usual = Settings()
    found = [Method(DEFAULT, "what quavelet runs by itself", _with(base, usual.filter, usual.denoise))]
    if (base.filter, base.denoise) != (usual.filter, usual.denoise):
        found.append(Method("as set", "filter and denoising of the settings given or recorded", base))
    papers = {
        "accelerometer": ("paper 000, method 1: each sample's tilt", FilterParams(kind="accelerometer")),
        "gyro": ("paper 000, method 2: the rate integrated", FilterParams(kind="gyro")),
        "P": ("paper 000, method 3: proportional feedback, kp 1", FilterParams(kind="p", kp=1.0)),
        "PID": ("paper 000, method 4: kp 1, ki 0.02, kd 0.5 as printed", PAPER_PID),
        "fusion": ("paper 003: six states, in the form that is stable", FilterParams(kind="fusion")),
    }
    found += [Method(name, what, _with(base, params, DenoiseParams())) for name, (what, params) in papers.items()]
    late = "paper 000, method 5: PID on rate and force denoised by db3, 2 levels, soft, which keeps slow motion"
    found.insert(-1, Method("wavelet PID", late, _with(base, PAPER_PID, PAPER_WAVELET)))
    return tuple(found)


def _with(base: Settings, params: FilterParams, denoise: DenoiseParams) -> Settings:
    return msgspec.structs.replace(base, filter=params, denoise=denoise)
