"""Limits of the bundle adjustment: every number that decides something, and where it is from."""

from __future__ import annotations

NEAREST = 0.1
"""Units of the adjustment, about metres. Points closer to the plane of a camera, or behind it, take
no part: their projections are not determined. Chosen; people stand further away."""

MAX_POINT_VARIANCE = 10.0
"""Ratio to the median. Joints of a larger variance take no part in velocities: they are in line
with the only two cameras that observe them. Chosen on simulated scenes of
benchmarks.accuracy.level; not verified on real recordings."""

MAX_NOISE_SUBTRACTED = 0.9
"""Fraction of what the keypoints know of any delay. More is never subtracted as noise, so that
the system stays positive definite. Chosen."""

MAX_NOISE_FRACTION = 0.5
"""Fraction of what the keypoints know of some delay. Where more is noise, offsets are not
compensated: the estimate of the noise is less certain than its effect. Chosen on simulated
scenes of benchmarks.accuracy.level; not verified on real recordings."""

MIN_BIAS_FRAMES = 0.1
"""Frames. Offsets that smoothed velocities move by less stay as they are: smoothing does that to
people who walk, too. Measured on simulated scenes of benchmarks.accuracy.level."""

MIN_NOISE_ENERGY = MIN_BIAS_FRAMES / 0.5
"""Ratio of removed to remaining energy of velocities. With less, offsets are biased by less than
`MIN_BIAS_FRAMES`, as none is further than half a frame from a whole one. Derived."""

OFFSET_CONVERGED_FRAMES = 0.01
"""Frames. Compensation by smoothed velocities has converged when no offset moves by more: a tenth
of what starts it. Derived."""

SMOOTHED_TOLERANCE = 0.5
"""Standard deviations. Adjustments with smoothed velocities end at steps below this; the next pass
goes on from there. Chosen."""

BODY_REACH = 1.2
"""Units of the adjustment, about metres. Joints further from the middle of their body belong to
another side or person. Derived: an arm or a leg is shorter, from the middle of the trunk."""

MAX_PATH_DEVIATION = 1.5
"""Units of the adjustment, about metres. Bodies further from the median of their path over three
seconds are other people. Derived: somebody who turns back from a run is off by less."""

MAX_DEPTH_SIGMA = 4.0
"""Standard deviations of a depth, beside `BODY_REACH` and `MAX_PATH_DEVIATION`. Derived: one joint
of 15,000 exceeds it by chance."""

LONGEST_CLUSTER = 150
"""Time bins, five seconds at 30 Hz. Longest span over which the errors of one joint of one person
count as one independent sample: a person turns within that. Chosen so that the normalised errors
of benchmarks.accuracy.consistency are 1."""

SHORTEST_CLUSTER = 9
"""Time bins. Shortest such span where a recording is short. Chosen: 0.3 s, less than a step."""

CLUSTERS_PER_UNKNOWN = 3
"""Count. Spans are halved until there are so many clusters per unknown: with fewer, the gradients
of the clusters are mostly fitted. Chosen."""

MIN_UNIT_BASELINE = 1e-3
"""Fraction of the spread of the cameras. Two cameras that are closer give no unit of length: their
distance is not known relative to itself. Derived: centres are known to about that at best."""

FURTHEST_BINS = 0.75
"""Time bins. An image is moved to the bin beside its nearest one, where jitter put two in one, if
it is no further from its middle. Derived: the motion model holds for half a bin or little more."""

MIN_SHARED_POINTS = 100
"""Observations, count. Two cameras are connected from this many shared inliers on. Chosen on
simulated scenes of benchmarks.accuracy.level; not verified on real recordings."""

MIN_SHARED_FRACTION = 0.1
"""Fraction of the keypoints of the camera with fewer. Two cameras that share less are not
connected: these are spurious matches. Chosen on simulated scenes; not verified on real
recordings."""

FIRST_FLOOR_PX = 15.0
"""Pixels. Reprojection errors below this do not count against an association with the rig of the
multi-view integration, whose poses are off by so much. Chosen on simulated scenes of
benchmarks.accuracy.level."""

FLOOR_PX = 12.0
"""Pixels. The same with an adjusted rig: what detectors are off by. Chosen on real recordings: the
man of pose2sim_balance is 4 to 8 px off, beside a woman without errors, and was taken for others
at 8."""

FIRST_TOLERANCE, TOLERANCE, FINAL_TOLERANCE = 2.0, 1.0, 0.3
"""Standard deviations. The first adjustment, those between and the last one end when a step moves
the cameras by less. Derived: 0.3 adds 5 % to the error."""

MAX_POINTS_FIRST, MAX_POINTS_BETWEEN = 5_000, 10_000
"""Count. Points of the first adjustment and of those before the last: joints are thinned to about
as many, which determine the poses to well within a pixel. Chosen for speed."""

MIN_JOINTS = 4
"""Count. So many joints are left of a person at least, so that all parts of an image are covered.
Chosen."""

ENOUGH_SLOTS = 12
"""Count. Slots of time that are enough before the last iteration: 600 samples. Chosen for speed."""

MIN_ITERATIONS = 3
"""Count. Iterations before the poses may count as converged. Chosen."""

CONVERGED_POSE = 1e-3
"""Radians, and fraction of the spread of the cameras. Poses that change by less between two
iterations have converged. Derived: a pixel of a usual camera is about as much."""

CONVERGED_FRAMES = 0.02
"""Frames. Offsets that change by less between two iterations have converged. Chosen: the offsets of
ten seconds are determined to about as much."""

OTHER_ROTATION = 0.1
"""Radians. Two solutions differ in a camera that is rotated by more. Chosen: far above the
uncertainty of any solution, far below the difference of two that contradict each other."""

OTHER_POSITION, OTHER_DISTANCE = 0.3, 0.03
"""Units of the adjustment, about metres, and fraction of the distance from the reference. Two
solutions differ in a camera that is displaced by more than the sum. Chosen like
`OTHER_ROTATION`."""

OTHER_SCALE = 1.1
"""Ratio. Two solutions of a scale that differs by less are compared at one scale: the size of the
people is not known better. Chosen."""

OTHER_OFFSET_FRAMES = 3.0
"""Frames. Two solutions differ in a camera whose time offset differs by more: the next correct
looking alignment of a walk is half a step away, ten frames and more. Chosen on simulated scenes of
benchmarks.accuracy.level --hard; not verified on real recordings."""

SAME_OFFSET_FRAMES = 0.5
"""Frames. Initial adjustments that differ by less in every offset came to one solution. Derived:
further iterations move offsets by up to half a frame, to where no frame is re-indexed."""

MIN_RIVAL_SUPPORT = 0.5
"""Fraction of the support of the best candidate rig. Candidates with less are not adjusted. Chosen
on simulated scenes of benchmarks.accuracy.level --hard; not verified on real recordings."""

CLOSE_SUPPORT = 0.8
"""Fraction of the support of the best candidate rig. All candidates above it are adjusted: of one
person who repeats a step, the right one had 0.88 (seed 4002 of benchmarks.accuracy.level)."""

MIN_RIGS_TRIED = 3
"""Count. As many candidate rigs are adjusted even if the first explains enough. Chosen for speed:
each costs a tenth of a calibration."""

MIN_EXPLAINED_TO_STOP = 0.6
"""Fraction of the keypoints of the least explained camera that are inliers. While no candidate
reaches it, more are tried. Chosen on simulated scenes; real detections explain less, so that more
candidates are tried there, at the cost of time only."""

MAX_FIT_LOSS = 0.3
"""Fraction of the fit of the best candidate. Candidates that lose less are adjusted once more
before one is chosen: people are associated better by then. Chosen on simulated scenes of
benchmarks.accuracy.level --hard."""

DECISIVE_FIT_GAIN = 0.1
"""Fraction of the keypoints of the cameras in which two solutions differ. A rival that fits worse
by less leaves the recording ambiguous. Chosen on benchmarks.accuracy.level --hard, where no wrong
solution wins by more; not verified on real recordings."""

MIN_FIT_SCALE_PX = 12.0
"""Pixels. Least scale of the robust count by which candidates are compared, four times the noise of
a usual detector: initial poses are not accurate. Chosen on simulated scenes."""
