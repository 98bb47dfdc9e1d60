"""The limits that decide whether a camera, and with it a calibration, is published or refused.

Those of the checks of single cameras are fields of a record, so that decisions can be replayed with
changed ones. The others are of the tests that need the whole solution: other time offsets,
look-alikes, repetition, lines. Lengths in the unit of the adjustment are about metres: people have
their usual size in it. Limits that say "chosen" were chosen on simulated scenes of
``benchmarks.accuracy.level`` and are not verified on real recordings.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class CheckThresholds:
    """Limits of `camera_checks.rejection` and of what follows from it.

    Where nothing else is said, a limit was chosen on the simulated scenes of
    ``benchmarks.accuracy.level``, and is not verified on real recordings.

    *Measured* is what ``benchmarks.accuracy.limits`` counts. On 173 simulated solutions all 15
    wrong ones are refused, and 22 of 158 good ones. On 22 solutions of one real clip, 12 of 16
    wrong ones are refused, and none of 6 good ones; those that are published are off by 0.076 and
    0.077 rad, where 0.07 counts as good and the truth is accurate to 0.05. *Alone* is without all
    other limits: most wrong solutions violate several. The same holds without bones of 3D poses.
    """

    min_inliers: int = 400
    """Keypoints, count. A camera needs as many inliers. Keypoints of one image are correlated: with
    17 of a person these are 24 images of one person. Chosen on simulated scenes, short ones.
    Measured: alone it refuses 4 wrong and 1 good simulated solutions, no real ones; 20 % either way
    changes nothing."""

    min_inlier_fraction: float = 0.55
    """Ratio. Inliers over all keypoints of the associated persons of a camera, at least: else its
    intrinsics are wrong or persons are exchanged. Chosen on simulated scenes.
    Measured: alone it refuses 1 wrong simulated and 4 wrong real solutions, no good ones; 20 %
    either way changes nothing. It also guards against wrong intrinsics, which the benchmark does
    not have."""

    min_explained_fraction: float = 0.5
    """Ratio. Inliers over all keypoints of a camera, of whomever, at least; unless its pose is
    certain by the three limits that begin with ``certain``. Two cameras that share nobody still
    find a pose at which somebody's steps agree for a while. Chosen on simulated scenes.
    Measured: alone it refuses 6 wrong and 2 good simulated, and 8 wrong real solutions; 20 %
    either way changes nothing."""

    min_shared_s: float = 2.5
    """Seconds. Motion that a camera shares with others, summed over persons, from which on
    `min_explained_fraction` is enough: in a second or two, other steps fit by chance. Chosen on
    simulated scenes, short ones.
    Measured: without it 3 wrong simulated solutions are published, and 15 more good ones; 20 %
    larger, 2 more wrong real ones are refused, and 1 more good simulated one."""

    min_explained_fraction_if_short: float = 0.7
    """Ratio. As `min_explained_fraction`, for a camera that shares less than `min_shared_s`.
    Chosen on simulated scenes, short ones.
    Measured: 20 % smaller, 1 wrong simulated solution is published and 10 more good ones; 20 %
    larger, 12 more good ones are refused."""

    certain_rotation_stddev: float = 0.0075
    """Radians. Below it the rotation is certain enough to allow a small explained fraction: half of
    `max_rotation_stddev`; right real solutions have 0.003 to 0.0065.
    Measured: without this exception 2 more good simulated solutions are refused, and no wrong one;
    20 % either way changes nothing."""

    certain_limb_variation: float = 0.08
    """Ratio of lengths, RMS. Below it the limbs confirm the pose, and allow the same: four
    fifths of `max_limb_variation`. Right real solutions with small explained fractions have 0.03 to
    0.07, wrong ones as certain as that by their covariance 0.15 and more.
    Measured: the benchmark has no wrong solution that it alone stops; 20 % either way changes
    nothing."""

    certain_bone_rotation: float = 0.15
    """Radians. Below it the monocular poses confirm the rotation, and allow the same, where there
    are any: half of `max_bone_rotation`. Sound simulated scenes stay below 0.1.
    Measured: nothing in the benchmark depends on it where limbs are compared."""

    certain_offset_peak_ratio: float = 2.0
    """Ratio of errors. Above it the time offset is distinct, and allows the same: right real
    solutions have 2.6 and more.
    Measured: nothing in the benchmark depends on it. It guards against strangers who walk in step,
    where another offset fits nearly as well."""

    max_bone_rotation: float = 0.3
    """Radians. Angle between the rotation of a camera and that of the monocular bones from which on
    persons count as exchanged: three times what sound simulated scenes have.
    Measured: alone it refuses 1 wrong simulated and 4 wrong real solutions, no good ones; 20 %
    either way changes nothing."""

    max_depth_ratio: float = 1.6
    """Ratio. Distance of people by triangulation over that by their size, relative to the other
    cameras: between 1 / 1.6 and 1.6, else persons count as exchanged. Sound simulated scenes are
    within 10 %.
    Measured: alone it refuses none; 20 % either way changes nothing. It guards against persons who
    are exchanged and whose limbs are not observed."""

    max_limb_variation: float = 0.1
    """Ratio of lengths, RMS. Variation of the limbs of the triangulated people, over time and
    between left and right, from which on the poses of cameras count as wrong. Between what right
    and wrong solutions of real recordings have: up to 0.087 (one man for 1.7 s), and 0.12 and more
    where nothing else refuses them. Right simulated ones have 0.01, and up to 0.05 with a keypoint
    bias of 20 mm.
    Measured: alone it refuses 12 of 16 wrong real solutions, 1 wrong simulated and no good ones;
    without it 2 more wrong real ones are published, 4 where the exception of
    `min_explained_fraction` does without it, too; 20 % either way changes nothing."""

    max_rotation_stddev: float = 0.015
    """Radians. Largest standard deviation of a rotation; 7.5 cm at a distance of 5 m. Chosen on
    simulated scenes.
    Measured: alone it refuses 3 wrong and 2 good simulated, and 4 wrong real solutions; 20 %
    either way changes nothing."""

    max_position_stddev: float = 0.10
    """Ratio. Largest standard deviation of a position over the distance from the people. Chosen on
    simulated scenes.
    Measured: alone it refuses none; 20 % either way changes nothing."""

    max_offset_stddev_frames: float = 1.0
    """Frames. Largest standard deviation of a time offset. Derived: with more, the images that are
    combined are not the nearest ones.
    Measured: alone it refuses none; 20 % either way changes nothing."""

    min_offset_peak_ratio: float = 1.2
    """Ratio. Error at the best other time offset over the error at the one found, at least.
    Periodic motion and people who stand bring it down to 1. Chosen on simulated scenes.
    Measured: alone it refuses none; 20 % larger, 2 more good simulated solutions are refused."""

    min_repetition_ratio: float = 1.05
    """Ratio of errors, px. Error of a camera at a repetition of the motion, moved with the people,
    over its error at its own place, at least: else nothing says that its time offset is not wrong
    by a period. Chosen on the scenes "one" and "gesturing" from keypoints only: a camera that is a
    period off has 0.95, the others of that scene 1.08 and more, those of right scenes 1.3.
    Measured: alone it refuses none; 20 % larger, 1 more good simulated solution is refused."""

    many_outliers: float = 0.2
    """Ratio. Fraction of outliers from which on offsets are also compared in all keypoints, as
    those that are outliers here may fit at the true offset. Chosen on simulated scenes: seed 2004
    with clips that repeat themselves."""

    min_offset_peak_ratio_with_outliers: float = 1.1
    """Ratio. As `min_offset_peak_ratio`, in all keypoints. Chosen on the same scene.
    Measured: alone it refuses 1 wrong and 2 good simulated, and 2 wrong real solutions; 20 %
    larger, 2 more wrong and 2 more good real ones, and 3 more good simulated ones."""

    max_failed_fraction: float = 0.5
    """Ratio. Cameras that fail are left out one by one while they are fewer than this fraction of
    all; else the solution as a whole is refused. Derived: of half and more, nothing says that it
    is they who are wrong."""


DEFAULT = CheckThresholds()
"""The limits that are in use."""

MIN_OFFSET_DIFFERENCE_FRAMES = 3
"""Frames. A time offset that is so far from the one found is another solution rather than its
uncertainty. Derived: three times the largest standard deviation of an accepted offset,
`CheckThresholds.max_offset_stddev_frames`."""

OFFSET_ERROR_SCALE = 2.0
"""Factor on the typical inlier error, px. Residuals beyond it count logarithmically where two
offsets are compared, so that a few outliers do not decide. Chosen."""

MIN_OFFSET_POINTS = 60
"""Observations, count. An offset of a camera is judged from so many pairs of observations on: below
that, it counts as not observable. Chosen."""

MAX_REPETITION_DISTANCE = 0.1
"""Unit of the adjustment (about m), root mean square. A motion repeats itself where one rigid
motion takes it to what it was to within this; then the error in the images decides. Measured on the
scenes "one": 0.04 and 0.05 of walks that repeat a stride, 0.10 at ratios of errors above 4."""

MAX_MOVED_DISTANCE = 0.8
"""Ratio. A motion repeats itself elsewhere if what is left after the best motion is less than this
fraction of the difference; else it repeats itself in place, which other offsets at the camera's own
place show. Measured: 0.4 and 0.7 on scenes "one" whose periods matter, 0.9 and more of people who
stand and gesture."""

MIN_REPETITION_OVERLAP = 0.5
"""Ratio. Fraction of what a camera observes for which the repetition has to be known. Chosen: less
says little about the rest of the clip."""

MIN_BONE_PAIRS = 100
"""Pairs of bone directions, count. Two cameras' relative rotation is compared with their 3D poses
from so many on. Derived: with errors of 10 degrees each they determine a rotation to about one,
far below `CheckThresholds.max_bone_rotation`."""

LIMB_BLOCK_S = 0.4
"""Seconds. Lengths of limbs are medians over stretches of it: shorter than a stride, so that a limb
does not turn much within, and long enough to average the noise of ten images. Chosen."""

MIN_LIMB_IMAGES = 3
"""Images, count. From so many on a median is taken of the length of a limb: with fewer, its scatter
and with it the noise is not known. Chosen."""

MIN_LIMB_SAMPLES = 8
"""Medians of lengths, count. From so many on it is known whether limbs vary: about two stretches
of time of four limbs. Chosen; the root mean square of fewer is uncertain by a quarter and more."""

MAX_LOG_DEVIATION = 1.0
"""Natural logarithm of a ratio of lengths. Larger deviations of a limb count as this, so that one
joint that is far away does not decide alone: a factor of e, beyond what bodies do. Chosen."""

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

SAME_PLACE_DISTANCE = 0.2
"""Unit of the adjustment (about m). Two people whose joints stay closer than this, median, are one
person whom the association took for two: nobody else fits there. Measured on pose2sim_balance: 0.03
of a person who was divided. Below half the width of a body."""

PERIOD_RANGE_S = (0.25, 3.0)
"""Seconds. Repetition with a period within is looked for: to explain a refusal, and as other time
offsets of a camera. Chosen by judgement: from the fastest steps to slow gestures."""

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

MIN_CHANGE_SIGNIFICANCE = 60.0
"""Squared difference over its variance from which on a camera counts as changed within a recording.
Measured with `LEAST_SCATTER`: up to 20 on simulated scenes with keypoint bias, up to 12 on real
recordings that are calibrated well, 55 on one that is not ("desk"); 79 and more of clocks that
change by 40 ms, of cameras that turn by 2 degrees, at any time, and of 3 % of lost images."""

MIN_CLOCK_CHANGE_S = 0.015
"""Seconds. A clock whose offset changes by less within a recording counts as steady: half a frame
at 30 Hz. Cameras beside one that changes by 40 to 100 ms are off by up to 13 ms themselves."""

MIN_ROTATION_CHANGE = 0.0175
"""Radians, one degree. A camera that turns by less within a recording counts as steady. With a
keypoint bias of 20 mm, cameras appear to turn by up to 0.9 degrees while people are at one side."""

MIN_DISPLACEMENT = 1.1
"""Multiple of the noise of keypoints. A camera has not turned whose keypoints are displaced by less
between two parts of a recording: keypoint bias does that while people are at one side. Measured:
0.86 with a bias of 20 mm that differs between cameras, 0.88 beside a camera that turned; of cameras
that turn by 2 degrees 2.0 and more, and by 3 degrees little by little 1.4."""

LEAST_SCATTER = 4.0
"""Ratio of variances. Changes scatter at least by so much more than if the errors of all keypoints
were independent. From window to window 0.1 to 1 is measured on simulated scenes without keypoint
bias, and 1 to 14 with it and on real recordings; it is less than over longer times, since people
stay where they are and keep the bias."""

MIN_STEADINESS_WINDOWS = 5
"""Windows, count. A camera is tested for changes within a recording from so many on: with fewer,
nothing is known of the scatter. Derived: three samples are compared with their neighbours."""

MAX_EVIDENCE_LEFT = 0.1
"""Ratio. The change of a camera explains the residuals of all if undoing it leaves less than this
of the largest evidence for a change. Measured with three cameras: 0.001 to 0.02 where the right one
is undone, 0.15 to 0.75 where another is."""

MAX_FIT_PX, MAX_FIT_RATIO = 12.0, 2.0
"""Pixels, and ratio to the usual residual of the camera. A window whose change leaves a larger
median residual says nothing of pose and clock: its persons are matched wrongly. Measured on
simulated scenes: 40 px after an exchange of ids, up to 11 px where a clock jumps to and fro within
a window."""

UNEXPLAINED_PX, UNEXPLAINED_RATIO = 5.0, 2.5
"""Pixels, and ratio to the usual residual of the camera. A change that leaves a larger median
residual does not explain a window. Measured: 26 to 37 px of clocks that are set by 0.5 s and of
cameras that turn by 20 degrees, 2 to 3 px of steady ones."""

MIN_UNEXPLAINED_WINDOWS = 3
"""Windows, count, in a row, of a second or less. A camera has changed by more than can be followed
if no small change explains so many. Measured on 80 simulated scenes with keypoint bias, occlusions
and exchanges of ids, and on real recordings: at most one."""

GAP_WINDOWS = 2.5
"""Lengths of a window. Windows in a row are no further apart: one between may say nothing, as
nobody is seen. Derived: the middle of the next but one is two lengths away."""

MAX_RMS_RATIO, MAX_RMS_PX = 4.0, 8.0
"""Ratio to the median reprojection error, and pixels. A solution with a larger root mean square
error of the keypoints that count as fitting is refused: some of them do not fit. Measured: 1.3 to
1.8 on good scenes, simulated and real, but 29 (with 2.8 px) where one of two people is computer
generated and without error; 4 to 7 (7.5 to 16 px) of clocks that jump to and fro."""

DELAY_STDDEV_S = 0.005
"""Seconds. Usual difference between the least delays of messages of one second and of another.
Chosen: drivers and networks of a house are within milliseconds."""

MIN_DELAY_CHANGE_S = 0.02
"""Seconds. Stamps that change by less against the times of receipt say nothing: a camera that is
given other work delays its messages by that. Chosen; below one image at 30 Hz."""

SUDDEN_FRACTION = 0.7
"""Ratio. A change of the delay is sudden if so much of it happens within the three seconds around
it. Derived: of a delay that grows evenly over ten seconds it is 0.6, and less over more."""
