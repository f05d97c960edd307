"""The methods that are set side by side: the papers' and the one that is the default, each a filter's settings."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

from quavelet.attitude.params import FilterParams
from quavelet.settings import Settings

DEFAULT = "default"


@dataclass(frozen=True, slots=True)
class Method:
    """A name for the legend, what it is, and the settings it runs with."""

    name: str
    what: str
    settings: Settings


def methods(base: Settings) -> tuple[Method, ...]:
    """All methods with everything but the filter as in `base`; first the default, and where `base` has another
    filter than that, then that one."""
    found = [Method(DEFAULT, "what quavelet runs by itself", _with(base, FilterParams()))]
    if base.filter != FilterParams():
        found.append(Method("as set", "the filter of the settings given or recorded", base))
    papers = {
        "gyro only": ("paper 000, method 2: the rate integrated", FilterParams(kind="gyro")),
        "P": ("paper 000, method 3: proportional feedback", FilterParams(kind="p", kp=1.0)),
        "PID": ("paper 000, method 4: as printed", FilterParams(kind="pid", kp=1.0, ki=0.02, kd=0.5)),
    }
    return (*found, *(Method(name, what, _with(base, params)) for name, (what, params) in papers.items()))


def _with(base: Settings, params: FilterParams) -> Settings:
    return msgspec.structs.replace(base, filter=params)
