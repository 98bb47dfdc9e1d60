"""Limits of following persons from image to image, and their origin."""

from __future__ import annotations

MAX_SAME_PERSON = 0.1
"""Ratio to the size of a person in the image. Two poses of one image whose joints are closer than
this, by the median, are of one person. Chosen: people who cover each other differ by more in size
or posture; benchmarks.estimation.tracking."""

MIN_DISTINCTION = 0.05
"""Ratio to the size of a person in the image. Who a pose is, is clear if anybody else would be
further from where they are expected by this much. Chosen: with 0.05 half as many tracks go on to
somebody else as without, with 0.1 few less, and a third more tracks are interrupted; benchmarks
.estimation.tracking."""

VELOCITY_TIME_S = 0.05
"""Seconds. Velocities of joints are means over about as long. Chosen: noise of keypoints is a
fraction of the motion of a step over it."""

SWING_S = 0.25
"""Seconds. Over longer gaps joints are expected to move on with the body alone. Derived: a leg
swings forward for 0.4 s."""

JOINT_MEMORY_S = 0.5
"""Seconds. The place of a joint that is not found is remembered for as long. Chosen like
`stcalib_ros.core.lifting.limits.LONGEST_BREAK_S`."""

SIZE_TIME_S = 2.0
"""Seconds. The size of a person in the image shrinks by a factor of e within: a body half of which
is hidden is no smaller. Chosen: people who walk away halve their size in no less."""

MIN_SIZE_PX = 1.0
"""px. A person is taken to be as large, also where all keypoints are at one place. Numerical."""

EXPECTATION_NOISE = 0.02
"""Ratio to the size of a person in the image. Standard deviation of a joint about where it is
expected after no time: noise of its place and of the velocity. Derived: 3 px of 200."""

SWING_ACCELERATION = 3.0
"""Sizes of a person per s^2. Standard deviation of the acceleration of a joint in the image.
Derived: an ankle swings by 0.35 m at 0.9 Hz, at most 6; 3 by the mean, as benchmarks.estimation
.tracking has it best."""

MAX_MISFIT = 6.0
"""Negative log likelihood. A joint counts no more than that: 3.5 standard deviations. Chosen."""

INDEPENDENT_JOINTS = 2.5
"""Joints, count. The likelihood of all joints is that of as many: their errors have causes in
common. Chosen on benchmarks.estimation.tracking: with 2 fewer exchanges are mended, with 4 some are
made."""

LEAST_PROBABILITY = 1e-6
"""Probability. Of two images at one time, nothing begins or ends between them. Numerical."""

BODY_BEGINS_PER_S = 0.05
"""1/s. How often left and right of the whole body are exchanged. Chosen: estimators do so in one of
a hundred images, most of all where a person is seen from behind."""

BODY_ENDS_PER_S = 2.0
"""1/s. How often such an exchange ends. Chosen: with 1 more true turns are taken for exchanges;
those of more than a few seconds are not found."""

LIMB_BEGINS_PER_S = 0.02
"""1/s. See `BODY_BEGINS_PER_S`; of both arms or both legs. Chosen: with 0.05 fast arms are taken
for exchanged."""

LIMB_ENDS_PER_S = 3.0
"""1/s. See `BODY_ENDS_PER_S`. Chosen: legs that pass each other part again within a third of a
second."""

MIN_SIDED_JOINTS = 2
"""Joints with a side, count. With fewer that are found in both images nothing is said about sides.
Derived: one pair."""
