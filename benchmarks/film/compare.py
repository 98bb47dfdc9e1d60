"""What an estimator found in one image beside what was there."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from benchmarks.film.figures import LANDMARK_BONES
from stcalib_ros.core.model.arrays import BoolArray, Float64Array

JOINT_NAMES = tuple(LANDMARK_BONES)
"""Joints that are compared: those of coco_17."""
_NEAR = 0.3
"""Fraction of a person's height in the image. Mean distance of the joints up to which somebody
found is somebody there: people who cross are nearer only where one hides the other."""
_APART = 0.08
"""Fraction of a person's height in the image. Left and right joints nearer than this to each other
cannot be called exchanged: a foreshortened pair is within the error of its joints."""
_EXCHANGED = 0.5
"""Ratio of the error with the sides exchanged to that as found, below which a pair is exchanged."""

_PARTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
_LEFT = [JOINT_NAMES.index(f"left_{part}") for part in _PARTS]
_RIGHT = [JOINT_NAMES.index(f"right_{part}") for part in _PARTS]


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Who is in one image.

    Attributes
    ----------
    keypoints : (P, 17, 2) ndarray
        Truth, px; NaN where unknown.
    heights_px : (P,) ndarray
        How tall they are in the image.
    clear : (P,) ndarray of bool
        In the image, and hidden by nobody.
    """

    keypoints: Float64Array
    heights_px: Float64Array
    clear: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """What was found in images.

    Attributes
    ----------
    errors_px, errors_relative : (N, 17) ndarray
        Distances of joints of those who were found from the truth; relative: as a fraction of
        height. NaN where the joint was not found or is not known.
    clear, clear_missed, hidden, hidden_missed : int
        People in clear view and hidden in part, and how many of them were not found.
    invented : int
        People found where nobody is.
    pairs, exchanged : int
        Pairs of left and right joints that lie apart, and how many of them were exchanged.
    images : int
    """

    errors_px: Float64Array
    errors_relative: Float64Array
    clear: int
    clear_missed: int
    hidden: int
    hidden_missed: int
    invented: int
    pairs: int
    exchanged: int
    images: int = 1


def compare(seen: Seen, found: Float64Array) -> Comparison:
    """Compare the people found, (Q, 17, 2) px with NaN for joints not found, with the truth."""
    distance = np.linalg.norm(seen.keypoints[:, None] - found[None], axis=-1)
    known = np.isfinite(distance)
    mean = np.where(known, distance, 0.0).sum(-1) / np.maximum(known.sum(-1), 1)
    cost = np.where(known.any(-1), mean / seen.heights_px[:, None], np.inf)
    who, what = linear_sum_assignment(np.minimum(cost, _NEAR))
    near = cost[who, what] < _NEAR
    who, what = who[near], what[near]
    missed = np.ones(len(seen.keypoints), dtype=bool)
    missed[who] = False
    errors = distance[who, what]
    pairs, exchanged = _exchanged(seen.keypoints[who], found[what], seen.heights_px[who])
    return Comparison(
        errors_px=errors,
        errors_relative=errors / seen.heights_px[who, None],
        clear=int(seen.clear.sum()),
        clear_missed=int((seen.clear & missed).sum()),
        hidden=int((~seen.clear).sum()),
        hidden_missed=int((~seen.clear & missed).sum()),
        invented=len(found) - len(what),
        pairs=pairs,
        exchanged=exchanged,
    )


def _exchanged(
    truth: Float64Array, found: Float64Array, heights_px: Float64Array
) -> tuple[int, int]:
    """Return how many pairs of joints lie apart and how many are exchanged."""
    left, right = truth[:, _LEFT], truth[:, _RIGHT]
    apart = np.linalg.norm(left - right, axis=-1) > _APART * heights_px[:, None]
    as_found = _both(left, found[:, _LEFT]) + _both(right, found[:, _RIGHT])
    crossed = _both(left, found[:, _RIGHT]) + _both(right, found[:, _LEFT])
    apart &= np.isfinite(as_found)
    return int(apart.sum()), int((apart & (crossed < _EXCHANGED * as_found)).sum())


def _both(a: Float64Array, b: Float64Array) -> Float64Array:
    return np.asarray(np.linalg.norm(a - b, axis=-1))


def total(parts: Iterable[Comparison]) -> Comparison:
    """Return the comparisons of several images as one."""
    some = list(parts)
    counts = {
        name: sum(getattr(part, name) for part in some)
        for name in Comparison.__dataclass_fields__
        if not name.startswith("errors")
    }
    return Comparison(
        errors_px=np.concatenate([part.errors_px for part in some]),
        errors_relative=np.concatenate([part.errors_relative for part in some]),
        **counts,
    )
