"""Limits of the bundle adjustment: every number that decides something, and where it is from."""

from __future__ import annotations

NEAREST = 0.1
"""Units of the adjustment, about metres. Points closer to the plane of a camera, or behind it, take
no part: their projections are not determined. Chosen; people stand further away."""

MAX_POINT_VARIANCE = 10.0
"""Ratio to the median. Joints of a larger variance take no part in velocities: they are in line
with the only two cameras that observe them. Chosen on simulated scenes of
benchmarks.accuracy.level; not verified on real recordings."""

MAX_NOISE_SUBTRACTED = 0.9
"""Fraction of what the keypoints know of any delay. More is never subtracted as noise, so that
the system stays positive definite. Chosen."""

MAX_NOISE_FRACTION = 0.5
"""Fraction of what the keypoints know of some delay. Where more is noise, offsets are not
compensated: the estimate of the noise is less certain than its effect. Chosen on simulated
scenes of benchmarks.accuracy.level; not verified on real recordings."""

MIN_BIAS_FRAMES = 0.1
"""Frames. Offsets that smoothed velocities move by less stay as they are: smoothing does that to
people who walk, too. Measured on simulated scenes of benchmarks.accuracy.level."""

MIN_NOISE_ENERGY = MIN_BIAS_FRAMES / 0.5
"""Ratio of removed to remaining energy of velocities. With less, offsets are biased by less than
`MIN_BIAS_FRAMES`, as none is further than half a frame from a whole one. Derived."""

OFFSET_CONVERGED_FRAMES = 0.01
"""Frames. Compensation by smoothed velocities has converged when no offset moves by more: a tenth
of what starts it. Derived."""

SMOOTHED_TOLERANCE = 0.5
"""Standard deviations. Adjustments with smoothed velocities end at steps below this; the next pass
goes on from there. Chosen."""

LONGEST_CLUSTER = 150
"""Time bins, five seconds at 30 Hz. Longest span over which the errors of one joint of one person
count as one independent sample: a person turns within that. Chosen so that the normalised errors
of benchmarks.accuracy.consistency are 1."""

SHORTEST_CLUSTER = 9
"""Time bins. Shortest such span where a recording is short. Chosen: 0.3 s, less than a step."""

CLUSTERS_PER_UNKNOWN = 3
"""Count. Spans are halved until there are so many clusters per unknown: with fewer, the gradients
of the clusters are mostly fitted. Chosen."""

MIN_UNIT_BASELINE = 1e-3
"""Fraction of the spread of the cameras. Two cameras that are closer give no unit of length: their
distance is not known relative to itself. Derived: centres are known to about that at best."""
