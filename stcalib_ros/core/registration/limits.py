"""Limits of pairwise registration: every number that decides something, and its origin."""

from __future__ import annotations

VOTE_THRESHOLDS = (0.8, 0.7, 0.6, 0.5)
"""Cosine-like agreement of bones after rotation, tried in this order: matches above it support a
proposal, and the next one is for pairs in which nothing agrees by the one before. Chosen on
simulated scenes of benchmarks.accuracy.level; not verified on real recordings."""

SAME_ROTATION = 0.15
"""rad. Hypotheses on a pair that differ by less in rotation, and by at most `SAME_LAG` in lag, are
one: about three standard deviations of rotations by poor 3D poses. Chosen on simulated scenes of
benchmarks.accuracy.level; not verified on real recordings."""

SAME_LAG = 3
"""Samples of the grid (0.1 s at 30 Hz). See `SAME_ROTATION`. Chosen on simulated scenes of
benchmarks.accuracy.level; not verified on real recordings."""

MAX_POSITION_DIFFERENCE = 0.35
"""Metres by the size of the people. Matches whose translations differ by less agree on one: half a
step, less than the distance between two people. Chosen on simulated scenes of
benchmarks.accuracy.level; not verified on real recordings."""

BODY_SIZE_RATIO = 1.25
"""Ratio. People may be larger or smaller than their lifter takes them for by this, which stretches
the translation. Derived: adults of 1.45 to 1.95 m taken for 1.70 m are within 17 %, and the lifter
errs as well."""

MIN_SUPPORT_RATIO = 0.3
"""Ratio to the support of the best hypothesis. Those with less are not refined on keypoints. Chosen
on simulated scenes of benchmarks.accuracy.level; not verified on real recordings."""

MIN_POINTS = 60
"""Keypoints. A hypothesis with fewer matched ones is not refined: three measurements at
`CORRELATED_KEYPOINTS`, for six unknowns with a prior on five. Chosen on simulated scenes of
benchmarks.accuracy.level; not verified on real recordings."""

CORRELATED_KEYPOINTS = 20
"""Keypoints per independent measurement: joints of one body in successive frames have errors in
common. Chosen on simulated scenes of benchmarks.accuracy.level; not verified on real recordings."""

MAX_ROTATION_STDDEV = 0.1
"""rad. Standard deviation of a registration by 3D poses is taken to be no larger, and is this where
too little is known. Chosen on simulated scenes of benchmarks.accuracy.level; not verified on real
recordings."""

DIRECTION_RATIO = 2.0
"""Ratio. Standard deviation of the direction of the translation over that of the rotation: it
depends on depths as well. Chosen on simulated scenes of benchmarks.accuracy.level; not verified on
real recordings."""

SCATTER_FACTOR = 2.0
"""Ratio. Blocks of a track are not quite independent, since neighbours have slow errors of the
poses in common: their scatter counts times this. Chosen on simulated scenes of
benchmarks.accuracy.level; not verified on real recordings."""

MIN_BASELINE_M = 1e-6
"""Metres by the size of the people. Cameras that are closer to each other have no epipolar
geometry, and their registration is not refined. Numerical."""

MAX_STEP_ROTATION = 0.2
"""rad per step. Longer rotations are cut, so that the linearization holds. Chosen."""

MIN_BONE_M = 1e-6
"""Metres. Shorter bones have no direction. Numerical."""
