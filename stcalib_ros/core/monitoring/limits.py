"""What the monitoring of a calibration decides by.

Where nothing else is said, a value was chosen on the simulated scenes of ``benchmarks.live.watch``
(rotations of 2 degrees, clock jumps of 100 ms and ten minutes without any change; 3 px of noise,
a keypoint bias of 20 mm, crowds with occlusions). They are not verified on real recordings.
"""

from __future__ import annotations

import numpy as np

SPAN_S = 2.0
"""Seconds. Length of a span, the unit of time of all decisions. Two or three steps of a walking
person, so that a clock jump shows; benchmarks.live.watch asks for an alarm within 10 s."""

KEPT_SPANS = 5
"""Spans, count. As many are kept, and as many in a row without detections raise an alarm (10 s);
a person who walks past an obstacle takes less. Chosen on benchmarks.live.watch."""

RECENT_SPANS = 5
"""Spans, count (10 s). The gains of as many are added up for an alarm about a change, so that old
evidence of another pose does not count. Chosen on benchmarks.live.watch."""

CONFIRMING_SPANS = 2
"""Spans, count. As many in a row must agree to start or to end an alarm: a single inconsistent
span is not rare with occlusions and exchanged ids. Chosen on benchmarks.live.watch."""

UNMATCHED_SPANS = 3
"""Spans, count. As many in a row without a match raise an alarm (6 s). One more than for a change,
since people who are hidden from one camera look the same. Chosen on benchmarks.live.watch."""

MIN_TOTAL_GAIN = 2.0
"""Log-likelihood gained by a change, summed over the recent spans, from which on it is significant:
odds of 7 to 1, with the joints of one body counted as correlated, see CORRELATED_POINTS. A turn of
one of two cameras that face each other gains .7 in a span with 20 mm of bias, spans without any
change 0 to .4 (benchmarks.live.watch); spans must agree as well."""

MIN_TOTAL_GAIN_WITH_SHIFT = 6.0
"""The same where a displacement of the camera is part of the change: a calibration may
determine the sum of rotation and displacement better than their difference. Three times
MIN_TOTAL_GAIN; chosen on the scenes with bias of benchmarks.live.watch."""

MIN_SPAN_GAIN = 0.3
"""Log-likelihood gained in one span from which on the span counts as suspicious at all; a seventh
of MIN_TOTAL_GAIN. Chosen on benchmarks.live.watch."""

MIN_SPAN_EFFECT = 0.5
"""Size of a change in one span, as a multiple of the user's thresholds, from which on the span
counts as suspicious: single spans err by about half a degree with a keypoint bias of 20 mm
(docs/watch.md), so the sum decides about the rest."""

MAX_DISAGREEMENT = 0.5
"""Difference of the changes of two spans, as a fraction of the change, up to which they may show
the same one. Differences within the user's thresholds always may. Chosen on
benchmarks.live.watch."""

MAX_MATCHED_FRACTION = 0.1
"""Fraction of the time steps with an expected person. A camera that matches somebody in no more of
them is unmatched. Above 0 for chance matches; chosen on benchmarks.live.watch."""

MIN_EXPECTED = 5
"""Time steps, count (one second, see matching.SAMPLES_PER_S). Without so many in which a person is
expected, a span does not make a camera unmatched. Chosen on benchmarks.live.watch."""

MAX_RESIDUAL_RATIO = 2.5
"""Epipolar distance over that of the calibration above which a camera disagrees with the others,
if no change explains it. Chosen on benchmarks.live.watch."""

MAX_RESIDUAL_PX = 20.0
"""Pixels. Epipolar distance up to which a camera never counts as disagreeing, however small the
residual of the calibration was. Chosen on the crowds of benchmarks.live.watch."""

MIN_MISSED_FRACTION = 0.9
"""Fraction of the time steps. A camera has no detections where in so many it should observe
somebody and has no person at all. Chosen on benchmarks.live.watch."""

MIN_GAIN_TO_CORRECT = 1.0
"""Log-likelihood gained by the change of a camera from which on the other cameras are tested with
that one corrected, and from which on a suspicious span counts in a run of unmatched ones.
Half of MIN_TOTAL_GAIN: it attributes, it does not raise an alarm."""

MIN_SHIFT_GAIN = 1.0
"""Log-likelihood that a displacement must gain beyond a rotation. The two can replace one another:
where a calibration knows their difference badly, people at other places than those it was made
from gain a little by both. Chosen on the scenes with bias of benchmarks.live.watch."""

MIN_SHIFT_GAIN_RATIO = 1.15
"""Gain with a displacement over the gain of the rotation alone, above which, with MIN_SHIFT_GAIN
beyond, the displacement is accepted: for large changes one unit is no evidence. Chosen on
benchmarks.live.watch."""

RIVAL_GAIN_RATIO = 0.7
"""Gain of another camera's change over that of the best, from which on it cannot be determined
which of the two has changed. With two cameras both explain the same residuals, and their gains
differ by noise alone. Chosen on benchmarks.live.watch."""

MAX_FIT_RATIO = 1.5
"""Residual that a change leaves over that of the calibration, up to which the change explains the
observations. Chosen on benchmarks.live.watch."""

MAX_FIT_PX = 12.0
"""Pixels. Residual that a change may always leave, for calibrations with very small residuals; four
times the noise of a usual detector (3 px). Chosen on benchmarks.live.watch."""

CORRELATED_POINTS = 60.0
"""Keypoints that make one independent measurement: the joints of one body share their errors, and
keep them over several frames. Log-likelihoods are divided by it. Larger than in registration (20),
where errors of different people average out over minutes. Chosen on benchmarks.live.watch."""

PRIOR_STDDEV = np.repeat([0.3, 0.3, 0.5], [3, 3, 1])
"""Standard deviations of a change (rad, m, s): what may have happened to a camera. Wide; a change
beyond it makes the camera unmatched, since persons are associated by the calibrated pose."""

MIN_POINTS = 40
"""Pairs of keypoints, count, below which no change of a camera is estimated: two or three bodies at
one moment, fewer than one independent measurement. Chosen on benchmarks.live.watch."""

MIN_POINTS_OF_PAIR = 20
"""Pairs of keypoints of two cameras, count, below which their residual is not measured: half of
MIN_POINTS; of more than 900 of a camera, every n-th is used."""

MIN_KEPT_FRACTION = 0.8
"""Fraction of the compared keypoints that a second pass with the corrected calibration must keep:
residuals that became smaller by losing points are no improvement. Chosen on
benchmarks.live.watch."""

ASSOCIATION_TOLERANCE_PX = 40.0
"""Pixels. Epipolar distance up to which persons of two cameras may be the same. Wide, since the
calibration may be out of date: a rotation of 2 degrees moves keypoints by 50 px at a focal length
of 1400 px, a good part of it along the epipolar lines."""

SAME_PLACE_M = 0.5
"""Metres. Two people are at one place where their monocular positions agree within this; decides
the size of the unit of length. Half of a body's depth error at 5 m."""

MAX_REASSIGNED_M = 2.0
"""Metres. Mean distance up to which an unmatched person of a camera may be a person of the others:
what a rotation by 20 degrees does at 5 m. A fit confirms or refuses it (MAX_FIT_RATIO)."""

MIN_COMMON_FRACTION = 0.5
"""Fraction of a span's time steps that two persons must have in common to be re-associated."""

MIN_DISTANCE_M = 0.3
"""Metres. Persons nearer to a camera are not expected in its image: only parts of them are."""

IMAGE_BORDER = 0.05
"""Fraction of the image size. Persons nearer to the border are not expected: detectors miss those
who are partly outside."""

MAX_LENS_RESIDUAL = 0.01
"""On the plane z = 1. Points whose projection does not lead back to within this are outside of the
domain of the lens model, far outside of the image. Undistortion itself is accurate to 0.01 px."""

NOISE_SPANS = 15
"""Spans, count (half a minute of people). The usual residual of two cameras is the median over so
many: a span in which trackers exchange ids leaves twice the residual of its neighbours."""

FIRST_NOISE_PX = 6.0
"""Pixels. Usual residual before anything has been seen, counted as one span. Between the 2.5 px of
good detectors without bias and the 7 to 10 px of those with 20 mm of it."""

MAX_NOISE_PX = 16.0
"""Pixels. Residuals above it that the best change of a camera leaves are not taken for noise, so
that a camera which nothing explains does not come to be usual. Noise is 2.5 to 12 px in the
simulated scenes of benchmarks.live.watch and 1 to 17 px in the real recordings of
benchmarks.accuracy.real; a camera that was replaced has 16 to 74 px (test_changed_scenes)."""

DRIFT_MEMORY_S = 20.0
"""Seconds. Time constant of the mean advance of a clock before the last spans: ten spans, which
err by 5 to 10 ms each, while a clock of 100 ppm drifts by 2 ms."""

MIN_DRIFT_FRACTION = 0.35
"""Fraction of a clock's advance that had come about before the last spans, from which on it has
drifted. Of jumps by 50 ms and more it is 0 to .2, by the errors of single spans; of a drift by 5 ms
from span to span, people being rare, or by 1000 ppm, it is .45 and more."""

MIN_GAP_S = 600.0
"""Seconds without anybody after which a clock's advance may be a drift or a jump: usual clocks (20
ppm and less) drift by 12 ms meanwhile, a quarter of the threshold of an alarm."""
