"""Whether the triangulated people have limbs of constant length: a check that needs keypoints only.

In two views, wrong poses of the cameras can have small residuals, but they distort space: a limb
that turns, or that is on the other side of the body, changes its length. The adjustment knows
nothing of limbs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.state import person_rows_of
from stcalib_ros.core.geometry.robust import RMS_OVER_MEDIAN
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.skeleton import Skeleton, bone_vectors
from stcalib_ros.core.validation.thresholds import (
    LIMB_BLOCK_S,
    MAX_LOG_DEVIATION,
    MIN_LIMB_IMAGES,
    MIN_LIMB_SAMPLES,
)

_MAX_BLOCKS = 150
"""Stretches of time, count, that are compared of each person; purely numerical: more of them do not
change a root mean square of nine limbs."""
_MEDIAN_VARIANCE = float(np.pi / 2.0)
"""Ratio of variances of the median and the mean of normally distributed samples, for many of them;
purely mathematical."""


class _Lengths(NamedTuple):
    """Lengths of limbs over T stretches of time, in C cameras: arrays (T, C, B)."""

    log_length: Float64Array
    variance: Float64Array
    images: Float64Array


def limb_variations(skeleton: Skeleton, last: Iteration) -> Float64Array:
    """Measure by how much the lengths of people's limbs vary over time and between sides.

    Parameters
    ----------
    skeleton : Skeleton
    last : Iteration

    Returns
    -------
    (C,) ndarray
        Root mean square of the relative deviations of the limbs that a camera takes part in, from
        the usual length of that limb of that person, left and right together. What the noise of
        the keypoints contributes is subtracted. NaN where too few lengths are known.
    """
    limbs = np.flatnonzero(np.isfinite(skeleton.adult_lengths))
    kinds = _kinds(skeleton, limbs)
    sums = np.zeros((3, len(last.rig.cameras)))
    for rows in person_rows_of(last.observations):
        lengths = _lengths(last, rows, skeleton.directions[limbs])
        for kind in range(kinds.max(initial=-1) + 1):
            sums += _deviations(_Lengths(*(values[..., kinds == kind] for values in lengths)))
    total, images, count = sums
    mean = np.maximum(total, 0.0) / np.maximum(images, 1.0)
    return np.where(count >= MIN_LIMB_SAMPLES, np.sqrt(mean), np.nan)


def _kinds(skeleton: Skeleton, limbs: IntArray) -> IntArray:
    """Number limbs (B,) so that the same limb of both sides has one number."""
    _, names = bone_vectors(skeleton.layout)
    plain = [names[b].replace("left_", "").replace("right_", "") for b in limbs]
    return np.unique(plain, return_inverse=True)[1]


def _lengths(last: Iteration, rows: slice, directions: Float64Array) -> _Lengths:
    """Median lengths of one person's limbs, of the images in which a camera observes all joints.

    NaN where these are too few.
    """
    obs, state = last.observations, last.state
    vectors = np.einsum("bj,njk->nbk", directions, state.X[rows], optimize=True)
    with np.errstate(divide="ignore"):
        log_length = np.log(np.linalg.norm(vectors, axis=-1))
    used = state.inlier[rows] & state.triangulated()[rows][:, None]
    missing = (~used).astype(np.float64) @ (directions != 0.0).astype(np.float64).T
    observed = np.where((missing == 0.0) & np.isfinite(log_length)[:, None], 1.0, np.nan)
    blocks = (obs.time_bin[rows] * obs.step_s / LIMB_BLOCK_S).astype(np.int64)
    found = []
    for block in _some(np.unique(blocks)):
        own = blocks == block
        values = log_length[own][:, None] * observed[own]
        n, middle = np.isfinite(values).sum(0), _median(values)
        scatter = RMS_OVER_MEDIAN * _median(np.abs(values - middle))
        variance = _MEDIAN_VARIANCE * scatter**2 / np.maximum(n, 1)
        enough = n >= MIN_LIMB_IMAGES
        found.append(
            (
                np.where(enough, middle, np.nan),
                np.where(enough, variance, np.nan),
                np.where(enough, n, 0).astype(np.float64),
            )
        )
    return _Lengths(*(np.array(values) for values in zip(*found, strict=True)))


def _some(blocks: IntArray) -> IntArray:
    return blocks[:: 1 + (len(blocks) - 1) // _MAX_BLOCKS]


def _median(values: Float64Array) -> Float64Array:
    """Median over the first axis of the finite ones of some values; NaN where there is none."""
    ordered, n = np.sort(values, axis=0), np.isfinite(values).sum(0)
    middle = np.stack([np.maximum(n - 1, 0) // 2, n // 2])
    middle = np.where(n > 0, middle, 0)
    return np.asarray(np.take_along_axis(ordered, middle, 0).mean(0))


def _deviations(one: _Lengths) -> Float64Array:
    """Sums (3, C) of squared deviations of one limb from its median, of images, and of lengths.

    Deviations are weighted by the images, less their variances, and scaled for the median that is
    taken from the same lengths.
    """
    C = one.images.shape[1]
    length, variance, images = (values.swapaxes(0, 1).reshape(C, -1) for values in one)
    n = (images > 0).sum(1).astype(np.float64)
    deviation = np.abs(length - _median(length.T)[:, None])
    squared = np.minimum(deviation, MAX_LOG_DEVIATION) ** 2
    total = np.nansum(images * squared, 1) * n / np.maximum(n - 1.0, 1.0)
    compared = n >= 2
    sums = np.stack([total - np.nansum(images * variance, 1), images.sum(1), n])
    return np.where(compared, sums, 0.0)
