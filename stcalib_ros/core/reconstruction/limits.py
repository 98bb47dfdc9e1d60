"""What the reconstruction of people and the resection of cameras decide by."""

from __future__ import annotations

MIN_TRACK_FRACTION = 0.25
"""Fraction of a track's time. A track is listed with a person if it shows this person for so long;
a track whose id was exchanged is listed with all whom it shows. Chosen on simulated scenes of
benchmarks.accuracy.level (their truth uses 0.2); not verified on real recordings."""

MAX_PEOPLE = 24
"""Persons, count, those observed longest. More are not needed to find a camera or to detect
ambiguous motion, and the cost of registration is quadratic in it. Cost alone."""

WIDEST_VIEW = 2.0
"""Units of the plane z = 1, tangent of the angle off the optical axis. People further from the axis
of the camera whose view of them is computed are left out: their points would outweigh all others.
Chosen: 127 degrees, about the widest lens that is modelled by a plane."""

MIN_FIT = 0.3
"""Fraction of a camera's keypoints that fit, each weighted by how well, below which resection has
failed. Wrong poses explain less, since keypoints of people who are not there do not fit. Chosen on
simulated scenes of benchmarks.accuracy.level; not verified on real recordings."""

MIN_MIRRORED_FIT = 0.5
"""Fraction of a camera's keypoints that fit, as `MIN_FIT`, if its image is mirrored. With more it
shows a mirror image. Chosen between: 0.72 to 0.79 of mirrored views in simulated scenes, less than
0.3 of views that are not mirrored and of other people."""

RIVAL_FIT_RATIO = 0.8
"""Fraction of keypoints that fit with another solution over that of the best, above which the
camera is ambiguous and stays out. Chosen on simulated scenes of benchmarks.accuracy.level; not
verified on real recordings."""

FIT_SCALE_PX = 12.0
"""Pixels. Scale of the Cauchy weight by which keypoints count as fitting; four times the noise of a
usual detector (3 px), so that its errors and biases do not matter and other people do."""

PERSON_SCALE_RATIO = 4.0
"""The same scale for the choice of persons, as a multiple: poses are still inexact then, and
persons are further from each other than 48 px in most images."""

MAX_SAME_DISTANCE = 0.12
"""Extents of a body. Two persons who are closer than this are at one place. Between what pose
estimators and calibration leave (0.06 on the film in examples/film) and two people who touch
(about 0.2). Chosen."""

MIN_SAME_FRACTION = 0.8
"""Fraction of the time bins in which two persons are both known, in which they have to be at one
place to be the same. The rest allows for tracks that go over to somebody else. Chosen."""

MIN_SAME_BINS = 3
"""Time bins, count, in which two persons have to be at one place, to be taken for the same. On the
film in examples/film, a person who was split where two trackers lost them has 4. Chosen."""

MAX_SEEN_BOTH_FRACTION = 0.5
"""Fraction of the time bins in which two persons are both known, in which a camera may see both: a
tracker may give somebody two ids for a moment (1 of those 4). Two people who are close to each
other are seen by most cameras as two. Chosen."""
