"""Limits of resection and of the reconstruction of people, with their origin."""

from __future__ import annotations

LOOSE_VOTE_THRESHOLD = 0.5
"""Cosine-like agreement of bones after rotation. For cameras whose 3D poses are too poor to agree
better: what fits is up to the keypoints afterwards. Chosen on the hard scenes of
benchmarks.accuracy.level; not verified on real recordings."""

RESECTION_SCALE_PX = 12.0
"""Pixels. Least scale of the robust loss, and the error at which a keypoint counts half as
explained. As `outlier_floor_px` of the bundle adjustment by default. Chosen on the hard scenes of
benchmarks.accuracy.level; not verified on real recordings."""

MIN_GAIN = 0.002
"""Fraction of the keypoints. Gauss-Newton has converged when a step explains less than this in
addition. Chosen on the hard scenes of benchmarks.accuracy.level; not verified on real
recordings."""

MAX_TURN = 0.2
"""rad per step. Longer rotations are cut, so that the linearization holds. Chosen."""

MAX_SHIFT_FRAMES = 2.0
"""Frames per step. Longer changes of the time offset are cut: velocities hold for about so long.
Chosen."""

OTHER_ROTATION = 0.1
"""rad. Two resections of a camera that differ by more in rotation are two solutions. Chosen on the
hard scenes of benchmarks.accuracy.level; not verified on real recordings."""

OTHER_POSITION = 0.3
"""Units of the adjustment, about metres. As `OTHER_ROTATION`, for the centre. Chosen on the hard
scenes of benchmarks.accuracy.level; not verified on real recordings."""

OTHER_OFFSET_FRAMES = 3.0
"""Frames. As `OTHER_ROTATION`, for the time offset. Chosen on the hard scenes of
benchmarks.accuracy.level; not verified on real recordings."""

RIVAL_RATIO = 0.8
"""Ratio of explained keypoints. A camera stays out if another solution explains more than this part
of what the best one does. Chosen on the hard scenes of benchmarks.accuracy.level; not verified on
real recordings."""

MIN_EXPLAINED = 0.3
"""Fraction of the keypoints of the camera. A resection that explains less is refused; the final
checks ask for more. Chosen on the hard scenes of benchmarks.accuracy.level; not verified on real
recordings."""

MIN_TRACK_FRACTION = 0.25
"""Fraction of the associated slots of a track. With less the track is not listed for the person:
trackers exchange ids, so that a track may show several. Chosen on simulated scenes of
benchmarks.accuracy.level; not verified on real recordings."""

MAX_PEOPLE = 24
"""Count. A camera is registered against the people who are observed longest, so many at most:
bounds the cost where ids are fragmented. Chosen."""

PERSON_SCALE_PX = 4.0 * RESECTION_SCALE_PX
"""Pixels. Error at which a keypoint counts half when persons are chosen: wider than in the fit,
since the pose is not yet known. Chosen on the hard scenes of benchmarks.accuracy.level; not
verified on real recordings."""
