"""Every number of reading and writing that decides something: value, unit, meaning, origin."""

from __future__ import annotations

MAX_FILES = 1000
"""Files. Nothing is exported to a folder of the history that holds as many, so that a caller of the
service cannot fill the disk with names. Chosen; not measured."""

PLUMB_BOB_COEFFICIENTS = 5
"""Distortion coefficients. Those of plumb_bob in OpenCV's order are k1 k2 p1 p2 k3; a longer list
is of the rational model. By definition."""

MAX_REPEATED_IDS = 0.5
"""Fraction of the images with several persons. Where an id repeats in more of them, nobody tracks
people, and ids are not used. Chosen: trackers repeat one in an image now and then at most, and an
estimator without a tracker that sends zeros does in all."""

SAME_PERSON = 0.15
"""Fraction of the height of the person in the image. A detection is of the true person whose joints
are nearest if their median distance is below this. It decides only which true identity a detection
gets. Chosen on the data sets that are read; not measured."""

MIN_COMMON_JOINTS = 4
"""Joints. A detection is compared with a true pose by at least so many. Chosen; not measured."""

MIN_BOX_OVERLAP = 0.3
"""Intersection over union. A detection is of the true person whose box overlaps best, from this on.
Chosen: boxes around keypoints are tighter than labelled ones; not measured."""
