"""ReID-Calib: people matched by appearance, then the essential matrix (Xu et al. 2021).

Xu, Li, Weng and Kitani, "Wide-Baseline Multi-Camera Calibration using Person Re-Identification",
CVPR 2021: boxes are matched across views by a re-identification network, the matches become point
correspondences, and RANSAC on the essential matrix gives the relative pose.

Assumed here: there are no images, so that the embeddings are simulated, with the rate at which the
nearest embedding of the other view is the right person stated (`RANK_1`). People are matched
one-to-one by the similarity of their mean embeddings. A matched person gives all joints of all
frames as correspondences, which is more exact than the boxes of the original. OpenCV's RANSAC;
matches whose joints the winner does not explain are given up.
"""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment

from benchmarks.paper.sfm import as_pose
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.relative_pose import RelativePose

RANK_1 = 0.8
"""How often the nearest embedding is the right one; networks trained elsewhere reach about that."""

_DIMENSIONS = 64
"""Dimensions of a simulated appearance embedding."""
_TRIALS = 400
"""Pairs of views from which the rank-1 rate is measured."""
_RANSAC_PX = 3.0
"""Distance from the epipolar line up to which a keypoint is an inlier, px."""
_EXPLAINED = 0.5
"""Fraction of inlier keypoints from which a match is kept."""
MIN_POINTS = 8
"""Correspondences from which a pair is registered (eight-point algorithm)."""


def embeddings(
    rng: np.random.Generator, persons: IntArray, prototypes: Float64Array, noise: float
) -> Float64Array:
    """Unit embeddings (P, D) of tracks, given the persons that they show."""
    e = prototypes[persons] + noise * rng.standard_normal((len(persons), prototypes.shape[1]))
    return np.asarray(e / np.linalg.norm(e, axis=1, keepdims=True))


def prototypes(rng: np.random.Generator, n_people: int) -> Float64Array:
    """Appearance of each person, (P, D)."""
    e = rng.standard_normal((n_people, _DIMENSIONS))
    return np.asarray(e / np.linalg.norm(e, axis=1, keepdims=True))


@cache
def noise_for(rank_1: float, n_people: int) -> float:
    """Noise of an embedding at which the nearest of `n_people` is right as often as stated."""
    low, high = 0.0, 4.0
    for _ in range(25):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rank_1_of(middle, n_people) > rank_1 else (low, middle)
    return 0.5 * (low + high)


def rank_1_of(noise: float, n_people: int) -> float:
    """Measured rate of right nearest neighbours, over simulated pairs of views."""
    rng = np.random.default_rng(0)
    everyone = np.arange(n_people)
    hits = []
    for _ in range(_TRIALS):
        looks = prototypes(rng, n_people)
        a, b = (embeddings(rng, everyone, looks, noise) for _ in range(2))
        hits.append((a @ b.T).argmax(1) == everyone)
    return float(np.mean(hits))


def matched(e_a: Float64Array, e_b: Float64Array) -> list[tuple[int, int]]:
    """One-to-one matches of embeddings by total cosine similarity."""
    rows, columns = linear_sum_assignment(-(e_a @ e_b.T))
    return [(int(p), int(q)) for p, q in zip(rows, columns, strict=True)]


def relative_pose(
    a: int,
    b: int,
    x_a: Float64Array,
    x_b: Float64Array,
    matches: list[tuple[int, int]],
    focal: float,
) -> RelativePose | None:
    """Relative pose of two views from the joints of matched people.

    Parameters
    ----------
    a, b : int
        Cameras, for the record.
    x_a, x_b : (P, T, J, 2), (Q, T, J, 2) ndarray
        On the planes z = 1; NaN where unknown.
    matches : list of (int, int)
    focal : float
        Pixels per unit of x.

    Returns
    -------
    RelativePose or None
        With a translation of length 1; None where no essential matrix fits.
    """
    p, q = np.array(matches, dtype=np.int64).reshape(-1, 2).T
    left, right = x_a[p], x_b[q]
    both = np.isfinite(left).all(-1) & np.isfinite(right).all(-1)
    if both.sum() < MIN_POINTS:
        return None
    E, mask = cv2.findEssentialMat(
        right[both], left[both], np.eye(3), cv2.RANSAC, 0.999, _RANSAC_PX / focal, maxIters=1000
    )
    if E is None or E.shape != (3, 3):
        return None
    _, R, t, mask = cv2.recoverPose(E, right[both], left[both], np.eye(3), mask=mask)
    inlier = mask.ravel() > 0
    explained = _share(both, inlier)
    kept = tuple(m for m, ratio in zip(matches, explained, strict=True) if ratio >= _EXPLAINED)
    return RelativePose(a, b, *as_pose(R, t), 0.0, kept, float(mask.sum() > 0) * float(both.sum()))


def _share(both: BoolArray, inlier: BoolArray) -> Float64Array:
    """Fraction of the correspondences of each match that are inliers."""
    count = np.zeros(both.shape)
    count[both] = inlier
    return np.asarray(count.sum((1, 2)) / np.maximum(both.sum((1, 2)), 1))
