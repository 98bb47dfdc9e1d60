"""What the paper's method (``registration.method: vmf``) decides by, beyond the paper."""

from __future__ import annotations

OUTLIER_FACTOR = 2.0
"""Ratio. Once a hypothesis of RANSAC is chosen, persons are matched up to this multiple of the mean
angle of its hypothesised persons, instead of the constant of the options. Chosen on
benchmarks.paper; the paper gives no rule."""

MIN_MATCH_LIMIT_RAD = 0.1
"""Radians. The limit above is never smaller: mean angles of monocular poses are 0.1 rad and more,
and exact poses would leave no tolerance. Chosen on benchmarks.paper."""

MIN_POINTS = 8
"""Pairs of keypoints, count, below which a pair gets no translation. The direction is determined by
two, and noise makes eight a small number already. Chosen; pairs that match have hundreds."""

MIN_LENGTH_M = 1e-3
"""Metres. Shortest translation of a pair: below it the direction, which the pose graph uses, would
be lost to rounding. Two cameras are never so close."""

MAX_KAPPA = 1e4
"""Concentration of a von Mises-Fisher distribution, about half a degree of standard deviation: five
frames that agree better do so by chance."""

MIN_SAMPLES = 2
"""Directions, count, from which on a concentration is estimated: one agrees with itself."""

POSE_STDDEV = (0.3, 0.06)
"""Metres and rad by which registrations of pairs are wrong, the same for all pairs: the relative
weight of translations and rotations in the pose graph. Of the order of the errors in the row PR of
benchmarks.paper; the paper weights by the identity."""
