"""Limits of scale and gravity alignment, with their origin."""

from __future__ import annotations

import numpy as np

LEG_RATIO_STDDEV = 0.04
"""Standard deviation of the logarithm of `LEG_RATIO`: proportions of people, and where layouts put
hips and ankles. Chosen: layouts differ by about 3 cm at the hip."""

LEG_RATIO = 0.491
"""Ratio. Length of thigh and shank over body height, adults. R. Drillis and R. Contini, "Body
segment parameters", 1966: 0.245 and 0.246."""

MAX_SCALE_CONFLICT = 4.0
"""Standard deviations of the difference. Two scale cues that differ by more contradict each other,
and no calibration is given. Derived: 1 in 16,000 for Gaussian errors."""

MAX_RAY_MISS = 0.05
"""Fraction of the distance. Lines of sight to one point that pass it by more are not to one point:
20 cm at 4 m, a wrong pixel or pairing. Chosen."""

LEAN_SCALE_RAD = np.radians(10.0)
"""rad. Scale of the robust mean of body directions: those further from the others count less.
Chosen on simulated scenes of benchmarks.accuracy.level; not verified on real recordings."""

OWN_LEAN_RAD = np.radians(6.0)
"""rad. Standard deviation of how far people lean on average while they face one way. Measured on
the motion capture clips that the package ships."""

MIN_UP_STDDEV_RAD = np.radians(0.3)
"""rad. Standard deviation of the direction up is not taken to be less: floors are level to about
this. Chosen."""

MAX_UP_STDDEV_RAD = np.radians(15.0)
"""rad. With a larger standard deviation of the direction up no world frame is given. Chosen on
simulated scenes of benchmarks.accuracy.level; not verified on real recordings."""

STEP_HEIGHT = 0.04
"""Leg lengths. Feet on the ground differ in height by about so much. Chosen on simulated scenes of
benchmarks.accuracy.level; not verified on real recordings."""

SOLE_STDDEV = 0.025
"""Leg lengths. Standard deviation of the height of the joint of a standing foot. Chosen: 2 cm."""

WIDEST_STEPS = 8.0
"""Ratio to `STEP_HEIGHT`. Scale at which the robust fit of the floor begins. Numerical."""
