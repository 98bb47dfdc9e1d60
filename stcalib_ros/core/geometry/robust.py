"""Constants of robust estimation."""

from __future__ import annotations

CAUCHY = 2.385


RAYLEIGH_MEDIAN = 1.17741


MIN_SCALE_PX = 0.5


LEAST_SHARE = 0.2
