"""Constants and the conversions used at the edges; SI inside."""

from __future__ import annotations

from math import pi

STANDARD_GRAVITY_M_S2 = 9.80665
RAD_PER_DEG = pi / 180.0
DEG_PER_RAD = 180.0 / pi
NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000
NS_PER_US = 1_000
