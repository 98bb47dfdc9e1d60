"""Limits of the tests that need the whole solution: other offsets, look-alikes, repetition, lines.

Lengths in the unit of the adjustment are about metres: people have their usual size in it.
"""

MIN_OFFSET_DIFFERENCE_FRAMES = 3
"""Frames. A time offset that is so far from the one found is another solution and not its
uncertainty. Derived: joints on smooth motion are indistinguishable within two frames; the standard
deviation of an accepted offset is below one."""

OFFSET_ERROR_SCALE = 2.0
"""Factor on the typical inlier error, px. Residuals beyond it count logarithmically when two
offsets are compared, so that wrong ones do not win or lose by a few outliers. Chosen on simulated
scenes of benchmarks.accuracy.level; not verified on real recordings."""

MIN_OFFSET_POINTS = 60
"""Observations, count. An offset of a camera can be judged from so many pairs of observations on.
Derived: three people-seconds of the joints that are looked at, at a fifth of a second per
independent pose; not verified on real recordings."""

MIN_BONE_PAIRS = 100
"""Pairs of bone directions, count. Two cameras' relative rotation is compared with their 3D poses
from so many on. Derived: at 10 degrees each they determine a rotation to one degree, far below
`camera_checks.MAX_BONE_ROTATION`."""

MIN_LOOKALIKE_SAMPLES = 8
"""Time steps, count. A person counts as observed by a camera, and two people as comparable, from
so many common ones on, of at most 200 over the clip. Chosen on simulated scenes of kind "alike";
not verified on real recordings."""

MIN_JOINTS_OF_PERSON = 6
"""Joints, count. A person is observed at a time step with so many inliers. Derived: a third of the
17 COCO keypoints, and more than a rigid motion of three points needs."""

MIN_LOOKALIKE_OVERLAP = 0.8
"""Fraction of the time for which a person is observed. A look-alike has to be known for so much of
it. Chosen on simulated scenes of kind "alike"; not verified on real recordings."""

MAX_LOOKALIKE_DISTANCE = 0.08
"""Unit of the adjustment (about m). Two people move alike if the root mean square distance of their
joints after one rigid motion is below it. Derived: joints of triangulated people scatter by 1 to
3 cm, the same step of different people differs by 10 cm and more."""

PERIOD_RANGE_S = (0.25, 3.0)
"""Seconds. Repetitions with a period within are looked for. Derived: nobody steps faster than four
times a second; slower repetition is a gesture that people do not keep up exactly."""

MIN_PERIOD_OVERLAP_S = 1.0
"""Seconds of a person's motion. Two stretches are compared over at least so much. Derived: about
one stride."""

MIN_PERIOD_RETURN = 0.9
"""Fraction of the way to a different pose and back. A motion has come back from so much on. Chosen
on simulated walks, which return by more than 0.95; not verified on real recordings."""

MIN_POSE_SIMILARITY = 0.97
"""Mean cosine between bone directions. Two poses above it are not distinguishable. Derived: bones
of a usual lifter are off by 10 degrees, the cosine of which is 0.985; of two of them, 0.97."""

MIN_LINE_LENGTH = 0.5
"""Unit of the adjustment (about m), standard deviation of positions. Below it people stand rather
than walk along a line. Derived: a line of about 2 m."""

MAX_LINE_WIDTH = 0.1
"""Unit of the adjustment (about m), standard deviation of positions across the line. Derived: the
middle of a walking person sways by less."""

LITTLE_SHARED_MOTION = 0.6
"""Fraction of the median shared time of the other cameras. A camera with less is advised to share
more; nothing is refused by it. Chosen by judgement; no benchmark depends on it."""
