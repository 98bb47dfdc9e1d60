"""Bipartite matching of persons on summed angles (eq. bp_cost), with "no match" allowed."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from stcalib_ros.core.model.arrays import BoolArray, Float64Array


def mean_angles(
    target: Float64Array,
    known_target: Float64Array,
    source: Float64Array,
    known_source: Float64Array,
    R: Float64Array,
) -> Float64Array:
    """Return the mean angle between oriented points after rotation over frames and joints, rad.

    The paper sums over the frames; the mean compares persons who are observed for different times.

    Parameters
    ----------
    target : (P, W, T, S, 3) ndarray
    known_target : (P, W, T, S) ndarray
        1 where they are known, else 0.
    source : (Q, H, W, T, S, 3) ndarray
        Oriented points at the offset of each of H hypotheses.
    known_source : (Q, H, W, T, S) ndarray
    R : (H, 3, 3) ndarray
        ``R_target_source`` of each hypothesis.

    Returns
    -------
    (H, W, P, Q) ndarray
        inf where the two have no frame in common.
    """
    turned = np.einsum("hij,qhwtsj->qhwtsi", R, source, optimize=True)
    out = np.full((len(R), target.shape[1], len(target), len(source)), np.inf)
    for q, one in enumerate(turned):
        cosine = np.einsum("pwtsi,hwtsi->hwpts", target, one, optimize=True)
        both = known_target.transpose(1, 0, 2, 3) * known_source[q][:, :, None]
        angle = both * np.arccos(np.clip(cosine, -1.0, 1.0))
        n = both.sum((-2, -1))
        out[..., q] = np.where(n > 0, angle.sum((-2, -1)) / np.maximum(n, 1.0), np.inf)
    return out


def match(angles: Float64Array, no_match_rad: float) -> BoolArray:
    """Find the best one-to-one association A of every window within an angle.

    Parameters
    ----------
    angles : (W, P, Q) ndarray
        Mean angles, rad; inf where impossible.
    no_match_rad : float
        Cost of a target person without a match.

    Returns
    -------
    (W, P, Q) ndarray of bool
    """
    A = np.zeros(angles.shape, dtype=bool)
    capped = np.minimum(angles, no_match_rad)
    for w, window in enumerate(capped):
        p, q = linear_sum_assignment(window)
        A[w, p, q] = window[p, q] < no_match_rad
    return A
