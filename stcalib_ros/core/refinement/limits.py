"""Limits of the refinement: every number that decides something, and where it is from."""

from __future__ import annotations

MAX_SKEW_STDDEV = 10e-6
"""s/s. A clock skew is estimated if its predicted standard deviation is at most this: clocks of
usual computers differ by a few ten ppm."""

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
