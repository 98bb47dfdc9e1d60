"""Two-view geometry of many pairs at once, with the lenses of the cameras as unknowns.

The unknowns are rotation, direction of t and lag of each pair, and focal length and radial
distortion of each camera; the residuals are Sampson distances in pixels. Pairs are padded to the
same number of points, so that all of them are one array.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.geometry.epipolar import decompose_essential, depths
from stcalib_ros.core.geometry.robust import MIN_NOISE_PX, NOISE_MARGIN, RMS_OVER_MEDIAN
from stcalib_ros.core.geometry.so3 import exp_so3, hat
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.registration.epipolar_correlation import best_essential, noise_of_moments
from stcalib_ros.core.registration.fov_lens import undistorted
from stcalib_ros.core.registration.limits import MAX_STEP_ROTATION

OF_PAIR, OF_LENSES = 6, 4
"""Unknowns of a pair, count: rotation, direction of t and lag; and of the lenses of its two
cameras. Derived: three, two and one; two of each."""
_DIFFERENCE = 1e-6
"""Step of numerical derivatives: rad, seconds, logarithms. Numerical: root of the precision, over
values of a hundred."""
_REWEIGHTINGS = 4
"""Passes of iteratively reweighted least squares. Numerical: the refinement goes on from there."""
_MAX_LAG_STEP_S = 0.05
"""Seconds per step. Longer ones are cut: points move along their velocity only. Numerical."""


@dataclass(frozen=True, slots=True, eq=False)
class PairPoints:
    """Points that pairs of cameras have in common; P pairs, M points of each.

    Attributes
    ----------
    a, b : (P,) ndarray of int
        Cameras of the pairs.
    m_a, m_b : (P, M, 2) ndarray
        Points on the plane z = 1 by the lenses to start from.
    v_b : (P, M, 2) ndarray
        Time derivative of `m_b`, per second.
    observed : (P, M) ndarray of bool
        The others are padding.
    focal_a, focal_b : (P,) ndarray
        Focal lengths to start from, px.
    independent : (P,) ndarray
        Independent measurements that the points are worth, count.
    """

    a: IntArray
    b: IntArray
    m_a: Float64Array
    m_b: Float64Array
    v_b: Float64Array
    observed: BoolArray
    focal_a: Float64Array
    focal_b: Float64Array
    independent: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class TwoViews:
    """Relative poses of P pairs and lenses of C cameras.

    Attributes
    ----------
    lenses : (C, 2) ndarray
        Of the field-of-view model, relative to those to start from.
    R_a_b : (P, 3, 3) ndarray
    unit_t : (P, 3) ndarray
        Directions of t_a_b.
    lag_s : (P,) ndarray
        Further lag of the points of b.
    """

    lenses: Float64Array
    R_a_b: Float64Array
    unit_t: Float64Array
    lag_s: Float64Array

    def moved(self, pairs: Float64Array, lenses: Float64Array) -> TwoViews:
        """Return it after steps (P, 6) of the pairs and (C, 2) of the lenses."""
        turn = pairs[:, :3]
        length = np.linalg.norm(turn, axis=-1, keepdims=True)
        turn = turn * np.minimum(1.0, MAX_STEP_ROTATION / np.maximum(length, 1e-12))
        shift = (pairs[:, None, 3:5] @ _tangents(self.unit_t))[:, 0]
        lag = np.clip(pairs[:, 5], -_MAX_LAG_STEP_S, _MAX_LAG_STEP_S)
        return replace(
            self,
            lenses=self.lenses + lenses,
            R_a_b=exp_so3(turn) @ self.R_a_b,
            unit_t=_units(self.unit_t + shift),
            lag_s=self.lag_s + lag,
        )


def _units(v: Float64Array) -> Float64Array:
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


def _tangents(unit_t: Float64Array) -> Float64Array:
    """Return the two directions (P, 2, 3) in which unit vectors can move."""
    return np.asarray(np.linalg.svd(unit_t[:, None])[2][:, 1:])


@dataclass(frozen=True, slots=True, eq=False)
class _Rays:
    """Homogeneous bearings (..., M, 3) of both cameras, and their pixels per unit (..., M)."""

    x_a: Float64Array
    x_b: Float64Array
    focal_a: Float64Array
    focal_b: Float64Array

    def distances(self, E: Float64Array) -> Float64Array:
        """Return signed Sampson distances (..., M), px, of matrices (..., 3, 3)."""
        line_a, line_b = self.x_b @ np.swapaxes(E, -1, -2), self.x_a @ E
        square = ((line_a[..., :2] ** 2).sum(-1)) / self.focal_a**2
        square = square + ((line_b[..., :2] ** 2).sum(-1)) / self.focal_b**2
        return np.asarray((self.x_a * line_a).sum(-1) / np.sqrt(np.maximum(square, 1e-18)))


def _rays(
    points: PairPoints, lens_a: Float64Array, lens_b: Float64Array, lag_s: Float64Array
) -> _Rays:
    """Bearings by lenses (..., P, 2) at further lags (..., P)."""
    x_a, per_a = undistorted(points.m_a, lens_a[..., None, :])
    x_b, per_b = undistorted(points.m_b + lag_s[..., None, None] * points.v_b, lens_b[..., None, :])
    return _Rays(
        _homogeneous(x_a),
        _homogeneous(x_b),
        points.focal_a[:, None] * per_a,
        points.focal_b[:, None] * per_b,
    )


def _homogeneous(x: Float64Array) -> Float64Array:
    return np.concatenate([x, np.ones((*x.shape[:-1], 1))], -1)


def first_views(points: PairPoints, lenses: Float64Array) -> TwoViews:
    """Return the relative poses by the robust matrix of each pair, for given lenses (C, 2)."""
    still = np.zeros(len(points.a))
    rays = _rays(points, lenses[points.a], lenses[points.b], still)
    products = rays.x_a[..., :, None] * rays.x_b[..., None, :]
    products = products.reshape(*products.shape[:2], 9)
    w = points.observed.astype(np.float64)
    for _ in range(_REWEIGHTINGS):
        weighted = np.swapaxes(products * w[..., None], -1, -2)
        here, there = (np.swapaxes(x * w[..., None], -1, -2) @ x for x in (rays.x_a, rays.x_b))
        E = best_essential(weighted @ products, noise_of_moments(here, there))[1]
        r = rays.distances(E)
        w = points.observed / (1.0 + (r / _scales(r, points.observed)[:, None]) ** 2)
    poses = [_ahead(*pair) for pair in zip(E, rays.x_a, rays.x_b, points.observed, strict=True)]
    R, t = (np.stack(part) for part in zip(*poses, strict=True))
    return TwoViews(lenses, R, t, still)


def _ahead(
    E: Float64Array, x_a: Float64Array, x_b: Float64Array, observed: BoolArray
) -> tuple[Float64Array, Float64Array]:
    """Return the pose of a matrix with most points ahead of both cameras."""

    def ahead(pose: tuple[Float64Array, Float64Array]) -> int:
        return int((np.minimum(*depths(*pose, x_a[observed], x_b[observed])) > 0.0).sum())

    return max(decompose_essential(E), key=ahead)


def distances_px(points: PairPoints, views: TwoViews) -> Float64Array:
    """Return the signed Sampson distances (P, M) of all points, px."""
    rays = _rays(points, views.lenses[points.a], views.lenses[points.b], views.lag_s)
    return rays.distances(hat(views.unit_t) @ views.R_a_b)


def robust_scales(points: PairPoints, views: TwoViews) -> Float64Array:
    """Return the scales (P,) of the Cauchy loss on the distances of each pair, px."""
    return _scales(distances_px(points, views), points.observed)


def _scales(distances: Float64Array, observed: BoolArray) -> Float64Array:
    median = np.nanmedian(np.where(observed, np.abs(distances), np.nan), axis=-1)
    return np.asarray(np.maximum(MIN_NOISE_PX, NOISE_MARGIN * RMS_OVER_MEDIAN * median))


def linearized(points: PairPoints, views: TwoViews) -> tuple[Float64Array, Float64Array]:
    """Distances (P, M), px, and derivatives (P, M, 6 + 4) by the pair and its lenses, a before b.

    By differences: the weights of the distances depend on all unknowns as well, and a step without
    that would follow the noise where an unknown is weakly determined.
    """
    eye = np.eye(OF_PAIR + OF_LENSES + 1, OF_PAIR + OF_LENSES, k=-1) * _DIFFERENCE
    of_pair, of_a, of_b = np.split(eye[:, None], [OF_PAIR, OF_PAIR + 2], axis=-1)
    R = exp_so3(of_pair[..., :3]) @ views.R_a_b
    shift = (of_pair[:, :, None, 3:5] @ _tangents(views.unit_t))[:, :, 0]
    t = _units(views.unit_t + shift)
    rays = _rays(
        points,
        views.lenses[points.a] + of_a,
        views.lenses[points.b] + of_b,
        views.lag_s + of_pair[..., 5],
    )
    r = rays.distances(hat(t) @ R)
    return r[0], np.moveaxis((r[1:] - r[0]) / _DIFFERENCE, 0, -1)
