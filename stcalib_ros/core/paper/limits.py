"""Limits of the paper's own method, with their origin."""

from __future__ import annotations

OUTLIER_RATIO = 2.0
"""Ratio to the least mean angle of a hypothesis of RANSAC. Persons whose bones differ by more are
outliers. Chosen on the scenes of benchmarks.paper; the paper gives no value."""

MIN_OUTLIER_RAD = 0.1
"""rad. Outliers differ by at least this. Chosen on the scenes of benchmarks.paper; the paper gives
no value."""

MIN_POINTS = 8
"""Keypoints. With fewer matched ones there is no translation. Derived: two unknowns, four times
over."""

MIN_BASELINE_M = 1e-3
"""Metres. A translation is made no shorter, so that it has a direction. Numerical."""

EM_CONVERGED = 1e-6
"""Entries of the rotation matrix. Expectation-maximization has converged when no entry changes by
more. Numerical."""

MIN_SAMPLES = 2
"""Samples. A von Mises-Fisher distribution is fitted to no fewer: one has no concentration.
Derived."""

STBA_TOLERANCE = 0.05
"""Standard deviations. The adjustment has converged when no parameter moves by more. Chosen on the
scenes of benchmarks.paper; the paper gives no value."""

POSE_GRAPH_CONVERGED = 1e-10
"""Twist entries (metres, rad). Gauss-Newton has converged when none is larger. Numerical."""
