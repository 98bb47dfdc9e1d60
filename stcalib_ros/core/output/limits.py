"""What scale, gravity and the world frame are decided by."""

from __future__ import annotations

import numpy as np

MAX_SCALE_SIGMA = 4.0
"""Standard deviations of the difference of two scale cues beyond which they contradict each other:
1 in 16,000 for Gaussian errors, so that only wrong inputs are refused."""

MAX_SIZE_RATIO = 1.3
"""Ratio to the size of an adult, either way, beyond which a given distance contradicts the people.
Derived: adults are within 1.2, and children below 1.3 m of height beyond, whose height can be
given. Measured by true distances: 0.91 to 1.11, median of the people of 12 simulated recordings,
0.93 to 0.96 of three real ones."""

USUAL_SIZE_RATIO = 1.15
"""Ratio to the size of an adult, either way, beyond which it is remarked on. Derived: two standard
deviations of 4 % of the height of adults, and as much for where layouts put joints."""

MAX_RAY_MISS = 0.05
"""Fraction of the distance. Rays to one given point that miss each other by more are wrong: 3
degrees, beyond the error of any pose that passes the checks. Chosen so that mistyped pixels are
refused; not verified on real recordings."""

MAX_UP_STDDEV_RAD = np.radians(15.0)
"""Radians. Standard deviation of the direction up, above which there is no gravity frame:
people who sit or lie. Chosen; not verified on real recordings."""

MIN_UP_STDDEV_RAD = np.radians(0.3)
"""Radians. Standard deviation that the direction up has at least, whatever the number of people:
layouts put head and ankles systematically. Chosen."""

LEAN_SCALE_RAD = np.radians(10.0)
"""Radians. Scale of the Cauchy weight of body directions: those further than this from the others
count less. About three times how far walking people lean. Chosen."""

OWN_LEAN_RAD = np.radians(6.0)
"""Radians. How far people lean on average while they look the same way; the standard deviation of
one heading. Chosen for the simulated walkers; not verified on real recordings."""
