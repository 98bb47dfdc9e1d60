"""Limits of the refinement: every number that decides something, and where it is from."""

from __future__ import annotations

MAX_SKEW_STDDEV = 10e-6
"""s/s. A clock skew is estimated if its predicted standard deviation is at most this: clocks of
usual computers differ by a few ten ppm."""

MIN_SKEW_DEVIATIONS = 6.0
"""Standard deviations. A clock skew that is known less well is estimated if it is predicted to be
so far from zero. Measured: at most 2.5 on simulated scenes without timestamp jitter and 4.8 on real
recordings, all of which have none; 8 to 11 of 1000 ppm in 10 s."""

MIN_SKEW_DRIFT_S = 0.005
"""Seconds over the recording. Such a skew is estimated if it makes as much: what it does to the
images is less otherwise, and 5 ms of timestamp jitter appear as 2 ms of it (benchmarks.accuracy,
scenes "rates")."""

MAX_SIGNIFICANT_SKEW = 2e-3
"""s/s. Such a skew is estimated up to twice what rates of 29.97 and 30 Hz differ by; clocks that
run apart faster do something else than to run evenly."""

MIN_LOG_EVIDENCE = 10.0
"""Natural logarithm of a ratio of marginal likelihoods. Keypoint biases, or errors of timestamps,
are taken to exist if they explain the keypoints better by more than this: odds of 20,000 to 1, as
the Laplace approximation is off by less. Chosen."""

CONVERGED = 0.1
"""Standard deviations. Estimates that alternate with the velocities have converged when none moves
by more. Derived: adds 0.5 % to the error."""

MIN_OCCUPANCY = 0.95
"""Fraction of the time bins in which every camera has an image. With more, joints that are free in
every bin lose nothing against splines. Measured on the scenes "rates" and "default" of
benchmarks.accuracy.level."""

MAX_SPLINE_NOISE = 1.3
"""Ratio of the noise that splines leave over that of free joints. With more, people move faster
than the splines. Chosen on simulated scenes of benchmarks.accuracy.level; not verified on real
recordings."""

MIN_EVEN_CORRELATION = 0.5
"""Correlation between the corrections that the keypoints ask for and those to regular times. With
more, images are taken to be regular. Chosen on the scenes "rates" of benchmarks.accuracy.level."""

MIN_REGULAR_IMAGES = 30
"""Count. Timestamps of fewer images stay as they are: any are regular to some period. Chosen."""

MAX_IRREGULARITY = 0.4
"""Fraction of the period. Timestamps with a larger standard deviation from regular times are not
regular: random ones have 0.29 to their nearest number, and more where numbers may not repeat.
Measured on exponential intervals; test/core/refinement/test_regular_frames.py."""

MAX_DEPTH_VARIANCE_RATIO = 10.0
"""Ratio of the largest to the least variance of a joint, median. With more, velocities along the
depths are smoothed. Measured on benchmarks.accuracy.level and its real recordings: 1.9 to 4.6; two
cameras that face each other 14 to 53, 2 m above each other 25 to 34, side by side 240 and more."""
