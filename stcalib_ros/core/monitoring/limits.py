"""Limits of monitoring: every number that decides something, and its origin."""

from __future__ import annotations

MIN_KEPT_POINTS = 0.8
"""Fraction of the compared keypoints. A refinement of a change that loses more of them is dropped.
Chosen on simulated changes of benchmarks.live.watch; not verified on real recordings."""

CONFIRMING_SPANS = 2
"""Spans in a row. An alarm, and its end, need so many that agree. Chosen on simulated changes of
benchmarks.live.watch; not verified on real recordings."""

UNMATCHED_SPANS = 3
"""Spans in a row. A camera is unmatched after so many spans in which it matches nobody or
disagrees. Chosen on simulated changes of benchmarks.live.watch; not verified on real recordings."""

MIN_GAIN = 3.0
"""Log-likelihood of a run of spans. A change that gains less raises no alarm: odds of 20 to 1.
Chosen on simulated changes of benchmarks.live.watch; not verified on real recordings."""

MIN_SHIFT_GAIN = 6.0
"""Log-likelihood. As `MIN_GAIN` where a displacement is part of the change: turn and displacement
can stand in for one another, and a calibration may not know their difference. Chosen on simulated
changes of benchmarks.live.watch; not verified on real recordings."""

MIN_SPAN_GAIN = 0.3
"""Log-likelihood of one span. Spans with less are not suspicious. Chosen on simulated changes of
benchmarks.live.watch; not verified on real recordings."""

SUSPICIOUS_FRACTION = 0.5
"""Fraction of the thresholds of the user. A span is suspicious from half of what raises an alarm
on, and two spans show one change if they differ by no more than this fraction of it. Chosen on
simulated changes of benchmarks.live.watch; not verified on real recordings."""

MAX_MATCHED_FRACTION = 0.1
"""Fraction of the time steps at which a match was expected. A camera that matches at no more is
unmatched. Chosen on simulated changes of benchmarks.live.watch; not verified on real recordings."""

MIN_EXPECTED = 5
"""Time steps, a second. With fewer at which a match was expected nothing is concluded. Chosen on
simulated changes of benchmarks.live.watch; not verified on real recordings."""

DISAGREEMENT_RATIO = 2.5
"""Ratio to the expected residual. A camera whose residual is larger, and above `DISAGREEMENT_PX`,
with no change that explains it, is unmatched. Chosen on simulated changes of benchmarks.live.watch;
not verified on real recordings."""

DISAGREEMENT_PX = 20.0
"""Pixels. See `DISAGREEMENT_RATIO`: precise calibrations are not held to 2.5 times a small
residual. Chosen on simulated changes of benchmarks.live.watch; not verified on real recordings."""

NO_DETECTIONS_FRACTION = 0.9
"""Fraction of the time steps of a span. A camera that detects nobody at so many of them, though
people should be in its view, has no detections. Chosen on simulated changes of
benchmarks.live.watch; not verified on real recordings."""

CORRELATED_KEYPOINTS = 60.0
"""Keypoints per independent measurement: joints of one body at successive time steps. More than in
registration, as all samples are of one span. Chosen on simulated changes of benchmarks.live.watch;
not verified on real recordings."""

MIN_POINTS = 40
"""Keypoints. A change is fitted to no fewer: two or three bodies at one time step. Chosen on
simulated changes of benchmarks.live.watch; not verified on real recordings."""

WORTH_CORRECTING = 1.0
"""Log-likelihood. From this gain on, the other cameras are judged with the change of this one
applied. Chosen on simulated changes of benchmarks.live.watch; not verified on real recordings."""

SHIFT_GAIN = 1.0
"""Log-likelihood that a displacement must gain beyond a turn and a clock jump, in addition to
`SHIFT_GAIN_RATIO`. Where a calibration knows their difference badly, people at other places than
those it was made from gain a little by both. Chosen on simulated changes of benchmarks.live.watch;
not verified on real recordings."""

SHIFT_GAIN_RATIO = 1.15
"""Ratio of gains. See `SHIFT_GAIN`. Chosen on simulated changes of benchmarks.live.watch; not
verified on real recordings."""

RIVAL_RATIO = 0.7
"""Ratio of gains. Two cameras are suspected alike if the change of one explains at least so much of
what that of the other does. Chosen on simulated changes of benchmarks.live.watch; not verified on
real recordings."""

EXPLAINED_RATIO = 1.5
"""Ratio to the expected residual. A change explains what is observed if no more remains, or no more
than `EXPLAINED_PX`. Chosen on simulated changes of benchmarks.live.watch; not verified on real
recordings."""

EXPLAINED_PX = 12.0
"""Pixels. See `EXPLAINED_RATIO`. Chosen on simulated changes of benchmarks.live.watch; not verified
on real recordings."""

TOLERANCE_PX = 40.0
"""Pixels. Persons of two cameras up to this median epipolar distance may be one: wide, since the
calibration may be out of date. Chosen on simulated changes of benchmarks.live.watch; not verified
on real recordings."""

SAME_PLACE_M = 0.5
"""Metres. Two bodies that stand closer by some unit of length agree with it. Chosen on simulated
changes of benchmarks.live.watch; not verified on real recordings."""

MAX_REASSOCIATION_M = 2.0
"""Metres. The persons of a camera that matches nobody are tentatively taken for those who stand no
further. Chosen on simulated changes of benchmarks.live.watch; not verified on real recordings."""

BORDER_FRACTION = 0.05
"""Fraction of the size of the image. A person nearer to its border may be missed by a detector.
Chosen."""

MIN_OVERLAP = 0.5
"""Fraction of the time steps of a span. Two persons are compared for re-association if both are
observed at so many. Chosen on simulated changes of benchmarks.live.watch; not verified on real
recordings."""

MAX_REPROJECTION = 0.01
"""Units of the plane z = 1. Where a lens model maps a point into the image that it does not map
back to, within this, the point is outside of its validity. Numerical."""
