"""Limits of pairwise registration: every number that decides something, and its origin."""

from __future__ import annotations

SAME_ROTATION = 0.15
"""rad. Hypotheses on a pair that differ by less in rotation, and by at most `SAME_LAG` in lag, are
one: about three standard deviations of rotations by poor 3D poses. Chosen on simulated scenes of
benchmarks.accuracy.level; not verified on real recordings."""

SAME_LAG = 3
"""Samples of the grid (0.1 s at 30 Hz). See `SAME_ROTATION`. Chosen on simulated scenes of
benchmarks.accuracy.level; not verified on real recordings."""

MIN_SUPPORT_RATIO = 0.3
"""Ratio to the support of the best hypothesis. Those with less are not refined on keypoints. Chosen
on simulated scenes of benchmarks.accuracy.level; not verified on real recordings."""

MIN_POINTS = 60
"""Keypoints. A hypothesis with fewer matched ones is not refined: six unknowns, and joints of one
body in successive frames have errors in common. Chosen on simulated scenes of
benchmarks.accuracy.level; not verified on real recordings."""

MIN_BASELINE_M = 1e-6
"""Metres by the size of the people. Cameras that are closer to each other have no epipolar
geometry, and their registration is not refined. Numerical."""

MAX_STEP_ROTATION = 0.2
"""rad per step. Longer rotations are cut, so that the linearization holds. Chosen."""

MIN_BONE_M = 1e-6
"""Metres. Shorter bones have no direction. Numerical."""

JUMP_FACTOR = 3.0
"""Ratio to the usual motion of the joints nearby. A track that moves more from one frame to the
next, and by `JUMP_FRACTION` more, has jumped to another person. Chosen on exchanges of ids in the
scenes of benchmarks.accuracy.level and in the clip of pose2sim_balance."""

JUMP_FRACTION = 0.03
"""Fraction of the height of a body in the image. See `JUMP_FACTOR`: noise alone is no jump where
somebody stands. Chosen on the same recordings."""

MAX_GAP_S = 0.5
"""Seconds. A track that was lost for longer may be somebody else afterwards. Chosen: within it
people go less than a body's width."""

MIN_PIECE_FRAMES = 10
"""Frames, count. Shorter pieces of a track register nothing. Derived: ten bodies of 17 joints are
170 points, but those of successive frames hardly differ."""

MIRRORED_FRACTION = 0.6
"""Ratio. Left and right are exchanged between two frames if the joints move by less than this part
of the way when they are exchanged back. Chosen on the clip of pose2sim_balance."""

MIN_FLIP_PX = 4.0
"""Pixels a joint. See `MIRRORED_FRACTION`: where the two sides are closer than the noise, nothing
is known. Chosen: about the noise of keypoints."""

MIN_FLIPPED_JOINTS = 6
"""Joints with a side, count. See `MIRRORED_FRACTION`: with fewer that are seen in both frames,
nothing is known. Chosen: half of the limbs' twelve."""

MAX_FLIP_S = 0.7
"""Seconds. Left and right that change places twice within are exchanged in between. Chosen: of a
longer exchange it is not known which side is right."""

SCAN_STEP_S = 1.0 / 15.0
"""Seconds. Lags are looked at in about these steps at first. Derived: at a walk the error of a lag
grows over a tenth of a second, so that every minimum has a lag in it."""

TYPICAL_JOINTS = 12
"""Joints of a person that are seen in a frame, count. ``registration.min_overlap`` counts frames,
of which a pair of tracks must have so many joints in common to be a seed. Chosen: two thirds of the
17 of COCO."""

MIN_SEED_POINTS = 16
"""Keypoints that two tracks have in common at a lag, whatever the options are. Derived: two for
each of the eight unknowns of a matrix."""

MIN_GROWTH_POINTS = 40
"""Keypoints. A seed takes in pairs of tracks with as many in common: what little there is of a
person adds up, once the matrix is known. Chosen on the same recordings."""

GROWTH_PX = 14.0
"""Pixels. A seed takes in pairs of tracks up to this Sampson distance (root mean square) under its
matrix. Chosen on the same recordings: keypoints of different models are 5 to 10 px off."""

GROWTH_FACTOR = 2.5
"""Ratio to the error of the seed. It takes in pairs of tracks with up to that many times its own,
where that is more than `GROWTH_PX`. Chosen on the same recordings."""

KEYPOINT_SCALE_PX = 8.0
"""Pixels. Scale of the Cauchy weight of Sampson distances where hypotheses are compared: usual
errors of keypoints of real pose estimators. Chosen on the same recordings."""

JOINT_PX = 7.0
"""Pixels. Where the matrix of a seed is far from a pair of tracks, but that of both together is
within `GROWTH_PX`, they agree up to this error (root mean square) of both. Chosen: usual errors of
keypoints; a stranger has 15 px and more."""

MAX_PIECES = 64
"""Pieces of tracks, count. So many of a camera are registered, the longest ones: pairs of them are
looked at one by one. Chosen: bounds time; a crowd of 15 has 64 pieces of a third of its time."""

MAX_PIECE_FRAMES = 200_000
"""Frames, count. Pieces times the length of the longest are no more: bounds the memory, to about
300 MB for two cameras and 17 joints. Numerical."""

MIN_LINK_FRAMES = 3
"""Frames, count. Shorter parts of a track are not linked to others: their motion is not known.
Derived: a velocity and a check of it."""

MIN_LINK_JOINTS = 6
"""Joints, count. Two pieces are linked by so many joints that are seen in the last frame of one and
in the first of the other. Chosen: a third of the 17 of COCO."""

LINK_GAP_S = 0.2
"""Seconds. Pieces further from each other in time are not linked. Chosen: five frames at 25 Hz, in
which an arm swings by a third of its way."""

LINK_SPEED = 0.5
"""Body heights per second. Joints may be as fast against the middle of the body, beside
`JUMP_FRACTION`, for two pieces to be linked. Derived: an arm swings by 2 m/s, its median joint by
less than half of it, with 1.7 m of height."""

CORRELATED_KEYPOINTS = 20
"""Keypoints per independent measurement: joints of one body in successive frames have errors in
common. Where frames are left out, fewer. Chosen on simulated scenes of benchmarks.accuracy.level;
not verified on real recordings."""

MAX_ROTATION_STDDEV = 0.03
"""rad. 3D poses that know the rotation of a pair no better are not used: keypoints know it as well,
and real lifters err alike in all frames, which scatter does not show. Those of usual lifters and of
the demo's BlazePose have 0.055 to 0.1; a pair of the demo became 0.1 rad worse by them."""

DIRECTION_RATIO = 2.0
"""Ratio. Standard deviation of the direction of the translation over that of the rotation, at
least: it depends on depths as well. Chosen on simulated scenes of benchmarks.accuracy.level; not
verified on real recordings."""

SCATTER_FACTOR = 2.0
"""Ratio. Blocks of a track are not quite independent, since neighbours have slow errors of the
poses in common: their scatter counts times this. Chosen on simulated scenes of
benchmarks.accuracy.level; not verified on real recordings."""

CONTRADICTION_RAD = 0.1
"""rad. 3D poses whose rotation differs by more from that of the keypoints are not used: what the
start by keypoints itself may be off in a window of five frames. Chosen."""

MAX_SAMPLES_PER_IMAGE = 100
"""Samples of the grid per image of the camera that has most. The step is longer where there would
be more. Chosen: twice what `MAX_GRID_FACTOR` of the input leaves; usual recordings have 1 to 3."""

FOCAL_BOUNDS = (-1.5, 1.3)
"""Logarithm of a focal length over that of `assumed_lens`, least and greatest: views of 140 to 20
degrees. Chosen: beyond the 30 to 120 degrees that are searched, so that noise does not hit them."""

RADIAL_BOUNDS = (-0.5, 0.3)
"""Radial coefficient of a lens, least and greatest. Derived: -1/3 is an equidistant lens, with a
margin for noise."""

MOST_BENT = -1.0 / 6.0
"""Radial coefficient of a lens. One with a lower one is taken for an equidistant lens, one with a
higher one for a plumb bob. Derived: half-way between an equidistant lens and a pinhole, so that k1
of either is the smaller one. Found in 24 views of each kind: -0.37 to -0.3 of equidistant ones of
125 degrees, -0.34 to -0.21 of those of 95; -0.11 to -0.07 with k1 = -0.1 and k2 = 0.012, and -0.01
to 0.03 of pinholes, of 125 degrees. With k1 = -0.25 and k2 = 0.06, -0.29 to -0.22: an equidistant
lens with a k1 fits as well."""

SURELY_BENT = 5.0
"""Standard deviations that the radial coefficient of an equidistant lens is from a pinhole, at
least. Measured: 17 and more of views of 125 degrees; 3.3 of a pinhole of 59 degrees with keypoint
bias, for which both do."""

FOCAL_START = -0.5
"""Logarithm of a focal length over that of `assumed_lens`, from which the search for one starts: a
view of 92 degrees. Chosen on views of 45 to 125 degrees: from there all are found, from 64 degrees
those of 125 are not."""

FOCAL_STDDEV = 0.5
"""Standard deviation of the logarithm of an unknown focal length over that of `assumed_lens`.
Derived: views of 30 to 120 degrees are within 2.1 of it. With 0.35, focal lengths of the demo, with
views of 36 degrees, come out 35 % too short; with 0.5 they are off by 9 % at most."""

LOOP_SCALES = (0.3, 0.03)
"""rad. Scales of the Cauchy loss on the turns of rotation loops, in successive rounds of the search
for lenses. From very wrong lenses, loops are off by a tenth and more. At the end, those of right
ones are off by 0.005 to 0.02 (simulated) and 0.05 (demo). Focal lengths in scenes of
benchmarks.accuracy.level, in the median: off by 1.4 % without loops, 0.4 % with 0.03 or 0.01
(default); 7 % and 1.2 % (20 mm of keypoint bias)."""

RADIAL_STDDEV = 0.15
"""Standard deviation of the radial coefficient of a lens. Chosen: usual lenses have -0.2 to 0, and
that of a fisheye, -1/3, is within 2.3. Of 0.1, 0.15 and 0.2 it measured best on equidistant lenses
and on those with k1 = -0.1; the default scenes do not depend on it."""

LENS_KEYPOINTS = 45
"""Keypoints of a pair per independent measurement of its lenses: errors of keypoints, and keypoint
bias above all, stay for long. Measured: with it, the squared errors of logarithms of focal lengths
are on average 0.6 (default), 1.0 (20 mm of keypoint bias), 1.8 (8 cameras) and 0.5 (wide) times
their variances in scenes of benchmarks.accuracy.level."""
