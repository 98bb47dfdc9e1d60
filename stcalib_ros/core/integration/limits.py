"""Limits of the multi-view integration: every number that decides something, and its origin."""

from __future__ import annotations

ROTATION_SCALE = 0.06
"""rad. Scale of the Cauchy-like agreement of a hypothesis with a rig: the usual error of a
registration by 3D poses. Chosen on simulated scenes of benchmarks.accuracy.level; not verified on
real recordings."""

POSITION_SCALE = 0.5
"""Metres by the size of the people. As `ROTATION_SCALE`, for the translation. Chosen on simulated
scenes of benchmarks.accuracy.level; not verified on real recordings."""

MIN_PARALLAX = 0.03
"""Ratio. Distance of two cameras over that of the people, at which they count as two. Cameras at
one place look 0.014 to 0.028 apart with 3 px of noise at 1000 px. Chosen on simulated cameras at
one place, as in test/core/test_refusals.py."""

LENGTH_WEIGHT = 0.1
"""Ratio of weights. The length of a translation counts for so much of its direction: it is known by
the size of the people only, to 15 %, and the direction by keypoints, to 0.05 rad. Derived."""

MIN_LENGTH = 1e-9
"""Metres by the size of the people. Shorter translations have no direction. Numerical."""

LAG_SCALE_FRAMES = 0.7
"""Frames. As `ROTATION_SCALE`, for the lag. Chosen on simulated scenes of
benchmarks.accuracy.level; not verified on real recordings."""

MAX_RIGS = 8
"""Count. So many rigs that differ are averaged and handed on; initialization adjusts the best few
of them. Chosen on simulated scenes of benchmarks.accuracy.level; not verified on real
recordings."""

MAX_DEPTH_ERROR = 0.2
"""Fraction of the depth of a body by its size. Bodies that are further from each other than that of
both depths together are hardly one person: half the cost of a merge at this distance. Derived: what
people differ in size by and limbs are foreshortened; in pose2sim_balance opposite cameras place one
man up to 1.6 m apart at 4 m."""

USUAL_BODY_DISTANCE = 0.6
"""Ratio to the distance by `MAX_DEPTH_ERROR`. Bodies further from each other count as strangers
where the usual epipolar distance is measured. Chosen: 1.2 m for two cameras at 5 m from somebody,
less than what most strangers keep."""

MIN_SHARED_KEYPOINTS = 12
"""Keypoints of a slot (samples times joints). With fewer in common two pieces have no distance:
about one frame of a body. Chosen on simulated scenes of benchmarks.accuracy.level; not verified on
real recordings."""

TOLERANCE_FACTOR = 3.0
"""Ratio to the usual distance of mutually nearest pieces. Pieces up to this distance may be one
person. Chosen on simulated scenes of benchmarks.accuracy.level; not verified on real recordings."""

MERGE_COST = 1.0
"""Cost: 1 at the tolerance of the epipolar distance. Groups are merged below it. Derived: pieces
within the tolerance belong together."""

BODY_WEIGHT = 0.5
"""Cost of a merge at `MAX_DEPTH_ERROR`, beside that of the epipolar distance: monocular depths
are worse than keypoints. Chosen on simulated scenes of benchmarks.accuracy.level; not verified
on real recordings."""

FEW_SAMPLES_COST = 0.25
"""Cost. Pieces seen together in n samples of a slot wait for those that are closer by this over n.
Chosen on examples/film with MoveNet at 256 px, where in one sample a stranger was closer by 0.02
than the person in three."""

MAX_COST = 10.0
"""Cost. One pair of pieces adds no more to the mean of a group: an id exchanged within the slot
must not split a person. Chosen on simulated scenes of benchmarks.accuracy.level; not verified on
real recordings."""

MIN_RELIABILITY_RATIO = 0.2
"""Ratio. A hypothesis connects two cameras if it is that reliable, compared with the best one of
whichever of them has less. Strangers reach 0.16 and 0.19 in the scenes of two groups of cameras;
pairs of real cameras that share one of two people reach 0.34. Chosen between."""

EPIPOLAR_SCALE_PX = 8.0
"""Pixels. A refined hypothesis counts half at this median epipolar distance. Chosen on simulated
scenes of benchmarks.accuracy.level; not verified on real recordings."""

DIFFERENT_ROTATION = 4 * ROTATION_SCALE
"""rad. Rigs that differ by more would not converge to one in averaging. Derived from the scale."""

DIFFERENT_POSITION = 3 * POSITION_SCALE
"""Metres by the size of the people. As `DIFFERENT_ROTATION`, for centres."""

DIFFERENT_LAG_FRAMES = 4 * LAG_SCALE_FRAMES
"""Frames. As `DIFFERENT_ROTATION`, for time offsets; derived from the scale likewise."""
