"""Radial distortion: how far off the axis a lens images what it sees at an angle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.recording import Intrinsics, LensModel

_MOST_TERMS = 4
"""Coefficients of the longest polynomial, count: that of the equidistant lens. By definition."""
LEAST_SLOPE = 0.01
"""Ratio. A lens whose image grows more slowly towards the edge has no useful inverse there.
Numerical: keeps derivatives finite."""
_FARTHEST = 20.0
"""Units of the plane z = 1. No point is further from the axis. Numerical: bounds the search."""
_WIDEST = 1.4
"""Radians off the axis, 80 degrees: where the search for wider points begins. Numerical."""
_CONVERGED = 1e-9
"""Units of the plane z = 1. A smaller last step of Newton's method ends it. Numerical: the error is
its square."""
_TINY = 1e-12
"""Units of the plane z = 1. A point at the axis. Numerical: avoids a division by zero."""


@dataclass(frozen=True, slots=True, eq=False)
class RadialProfile:
    """Radial distortion of C lenses.

    A point at the distance r from the axis on the plane z = 1 has its image at ``g(r)``, in units
    of the focal length: ``g = t (1 + k_1 t^2 + ...) / (1 + q_1 t^2 + ...)`` with ``t = r``, and
    ``t = arctan r`` of an equidistant lens.

    Attributes
    ----------
    fisheye : (C,) ndarray of bool
        The lens is an equidistant one.
    k, q : (C, 4) ndarray
        Coefficients; 0 where there are none.
    """

    fisheye: BoolArray
    k: Float64Array
    q: Float64Array

    def only(self, cameras: slice | IntArray) -> RadialProfile:
        """Some of the lenses."""
        return RadialProfile(self.fisheye[cameras], self.k[cameras], self.q[cameras])

    def at(self, r: Float64Array) -> RadialPoint:
        """Distortion at distances r (..., C, P)."""
        if not (self.fisheye.any() or self.k.any() or self.q.any()):
            one = np.ones_like(r)
            return RadialPoint(r, r**2, one, one, one, one)
        fisheye, k, q = self.fisheye[:, None], self.k.T[..., None], self.q.T[..., None]
        t = np.where(fisheye, np.arctan(r), r) if fisheye.any() else r
        square = t**2
        numerator, growth = _polynomial(k, square)
        denominator, its_growth = _polynomial(q, square)
        ratio = numerator / denominator
        by_t = ratio + (growth - ratio * its_growth) / denominator
        t_over_r = np.ones_like(r)
        if fisheye.any():
            by_t = by_t * np.where(fisheye, 1.0 / (1.0 + r**2), 1.0)
            t_over_r = np.where(r > _TINY, t / np.maximum(r, _TINY), 1.0)
        slope = np.maximum(by_t, LEAST_SLOPE)
        return RadialPoint(r, square, t_over_r, ratio * t_over_r, slope, t_over_r / denominator)

    def inverse(self, d: Float64Array, *, steps: int) -> Float64Array:
        """Distances r (..., C, P) of the images at distances d, by Newton's method."""
        r = np.where(
            self.fisheye[:, None], np.tan(np.minimum(d, _WIDEST)), np.minimum(d, _FARTHEST)
        )
        for _ in range(steps):
            at = self.at(r)
            before, r = r, np.clip(r - (at.gain * r - d) / at.slope, 0.0, _FARTHEST)
            if not (np.abs(r - before) > _CONVERGED).any():
                break
        return np.asarray(r)


@dataclass(frozen=True, slots=True, eq=False)
class RadialPoint:
    """Radial distortion at points.

    Attributes
    ----------
    r : (..., C, P) ndarray
        Distances from the axis on the plane z = 1.
    square : (..., C, P) ndarray
        t^2.
    t_over_r : (..., C, P) ndarray
    gain : (..., C, P) ndarray
        g / r.
    slope : (..., C, P) ndarray
        dg / dr.
    share : (..., C, P) ndarray
        Derivative of g / r by a coefficient of ``t^0``.
    """

    r: Float64Array
    square: Float64Array
    t_over_r: Float64Array
    gain: Float64Array
    slope: Float64Array
    share: Float64Array

    def by_coefficient(self, n: int) -> Float64Array:
        """Derivative of g / r by the coefficient of ``t^(2 n)``."""
        return np.asarray(self.share * self.square**n)


def _polynomial(c: Float64Array, square: Float64Array) -> tuple[Float64Array, Float64Array]:
    """``1 + c_1 s + c_2 s^2 + ...`` and twice its derivative times s, with ``s = t^2``."""
    if not c.any():
        return np.ones_like(square), np.zeros_like(square)
    value, growth = np.zeros_like(square), np.zeros_like(square)
    for n, one in reversed([*enumerate(c, start=1)]):
        if value.any() or one.any():
            value, growth = (value + one) * square, (growth + 2 * n * one) * square
    return 1.0 + value, growth


def radial_profile(lenses: Sequence[Intrinsics]) -> RadialProfile:
    """Return the radial distortion of some lenses; tangential distortion is not in it."""
    k, q = np.zeros((2, len(lenses), _MOST_TERMS))
    for c, lens in enumerate(lenses):
        own = radial_columns(lens)
        present = own[own < lens.D.size]
        k[c, : len(present)] = lens.D[present]
        denominator = lens.D[5:8]
        q[c, : len(denominator)] = denominator
    fisheye = np.array([lens.model is LensModel.EQUIDISTANT for lens in lenses], dtype=bool)
    return RadialProfile(fisheye, k, q)


def radial_columns(lens: Intrinsics) -> IntArray:
    """Return where k1, k2, ... are in the coefficients D of a lens."""
    equidistant = lens.model is LensModel.EQUIDISTANT
    return np.array([0, 1, 2, 3] if equidistant else [0, 1, 4], dtype=np.int64)


def is_radial(lens: Intrinsics) -> bool:
    """Whether a lens has square pixels' axes and no other distortion than a radial one."""
    bent = lens.model is not LensModel.EQUIDISTANT and bool(lens.D[2:4].any() or lens.D[8:].any())
    upright = np.array_equal(lens.R_rect_cam, np.eye(3)) and lens.K[0, 1] == 0
    return upright and not bent
