"""Limits of the tests that need the whole solution: other offsets, look-alikes, repetition, lines.

Limits of the checks of single cameras, by which solutions are published or refused, are in
`thresholds`. Lengths in the unit of the adjustment are about metres: people have their usual size
in it. Those that say "chosen" were chosen on simulated scenes of ``benchmarks.accuracy.level`` and
are not verified on real recordings.
"""

MIN_OFFSET_DIFFERENCE_FRAMES = 3
"""Frames. A time offset that is so far from the one found is another solution rather than its
uncertainty. Derived: three times the largest standard deviation of an accepted offset,
`thresholds.CheckThresholds.max_offset_stddev_frames`."""

OFFSET_ERROR_SCALE = 2.0
"""Factor on the typical inlier error, px. Residuals beyond it count logarithmically where two
offsets are compared, so that a few outliers do not decide. Chosen."""

MIN_OFFSET_POINTS = 60
"""Observations, count. An offset of a camera is judged from so many pairs of observations on: below
that, it counts as not observable. Chosen."""

MIN_BONE_PAIRS = 100
"""Pairs of bone directions, count. Two cameras' relative rotation is compared with their 3D poses
from so many on. Derived: with errors of 10 degrees each they determine a rotation to about one,
far below `thresholds.CheckThresholds.max_bone_rotation`."""

MIN_LOOKALIKE_SAMPLES = 8
"""Time bins, count, of at most 200 of a clip. A person counts as observed by a camera, and two
people as comparable, from so many common ones on. Chosen, on the scenes of kind "alike"."""

MIN_JOINTS_OF_PERSON = 6
"""Joints, count. A person is observed in a time bin by so many inliers. Derived: a third of the 17
keypoints of COCO; three would do for a rigid motion without noise."""

MIN_LOOKALIKE_OVERLAP = 0.8
"""Ratio. Fraction of the time for which a person is observed that a look-alike has to be known for.
Chosen, on the scenes of kind "alike"."""

MAX_LOOKALIKE_DISTANCE = 0.08
"""Unit of the adjustment (about m). Two people move identically if the root mean square distance of
their joints after one rigid motion is below it. Chosen, on the scenes of kind "alike": several
times the noise of triangulated joints there."""

PERIOD_RANGE_S = (0.25, 3.0)
"""Seconds. Repetition with a period within is looked for, to explain a refusal; nothing is refused
by it. Chosen by judgement: from the fastest steps to slow gestures."""

MIN_PERIOD_OVERLAP_S = 1.0
"""Seconds of a person's motion. Two stretches are compared over at least so much, to explain a
refusal. Derived: about one stride."""

MIN_PERIOD_RETURN = 0.9
"""Ratio. Fraction of the way to a different pose and back from which on a motion has returned, to
explain a refusal. Chosen, on simulated walks."""

MIN_POSE_SIMILARITY = 0.97
"""Mean cosine between bone directions. Two poses above it are not distinguishable, to explain a
refusal. Derived: bones of a usual lifter have errors of 10 degrees, the cosine of which is 0.985;
two of them, 0.97."""

MIN_LINE_LENGTH = 0.5
"""Unit of the adjustment (about m), standard deviation of positions. Below it people stand rather
than walk along a line. It explains refusals and chooses advice. Derived: 0.5 is the standard
deviation along a line of 1.7."""

MAX_LINE_WIDTH = 0.1
"""Unit of the adjustment (about m), standard deviation of positions across the line. It explains
refusals and chooses advice. Chosen by judgement: more than a walking person sways."""

LITTLE_SHARED_MOTION = 0.6
"""Ratio. A camera that shares less than so much of the median shared time of the others is advised
to share more. Nothing is refused by it. Chosen by judgement."""
