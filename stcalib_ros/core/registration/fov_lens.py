"""One family of lenses for narrow and wide views: the field-of-view model.

An image point at a radius r about the principal point, over the focal length, has its bearing at
``tan(w r) / w`` on the plane z = 1. With w = 0 this is a pinhole, with w = 1 an equidistant
fisheye; ``radial = -w^2 / 3`` is about the k1 of a plumb bob, and may be positive. The model has a
closed inverse everywhere, so that a search may go from one kind of lens to the other.

References
----------
F. Devernay and O. Faugeras, "Straight lines have to be straight", 2001.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.recording import Intrinsics, LensModel

LOG_FOCAL, RADIAL = 0, 1
"""Columns of a lens: logarithm of its focal length over that of the lens that it starts from, and
its radial coefficient."""
EQUIDISTANT = -1.0 / 3.0
"""Radial coefficient of an equidistant lens. Derived: w = 1."""
_MAX_ANGLE = 1.4
"""rad. Bearings are no further off the axis: beyond 80 degrees they have no use. Numerical."""
_FIT_RADII = 40
"""Count. Radii at which a plumb bob is fitted. Numerical."""


def undistorted(points: Float64Array, lens: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return points of a pinhole by the lens to start from as bearings by another lens.

    Parameters
    ----------
    points : (..., 2) ndarray
        On the plane z = 1 by a pinhole of the focal length to start from.
    lens : (..., 2) ndarray
        Logarithm of the ratio of focal lengths, and radial coefficient.

    Returns
    -------
    x : (..., 2) ndarray
        On the plane z = 1.
    focal : (...) ndarray
        Pixels per unit of x over pixels per unit of `points`.
    """
    ratio = np.exp(-lens[..., LOG_FOCAL])
    bend = -3.0 * lens[..., RADIAL]
    r = ratio * np.sqrt((points**2).sum(-1))
    q = np.maximum(np.sqrt(np.abs(bend)) * r, 1e-9)
    inward = np.minimum(q, _MAX_ANGLE)
    stretch = np.where(bend > 0.0, np.tan(inward) / inward, np.tanh(q) / q)
    steepness = 1.0 + bend * (stretch * r) ** 2
    x = points * (ratio * stretch)[..., None]
    return x, 1.0 / (ratio * np.sqrt(stretch * np.maximum(steepness, 1e-9)))


def fitted_lens(
    start: Intrinsics, lens: Float64Array, *, radius: float, radial_terms: int
) -> Intrinsics:
    """Return a lens of this family as an equidistant one, if it is, or the nearest plumb bob.

    Parameters
    ----------
    start : Intrinsics
        A pinhole: what the lens is relative to.
    lens : (2,) ndarray
        Logarithm of the ratio of focal lengths, and radial coefficient.
    radius : float
        Largest radius about the principal point to be fitted, on the plane z = 1 by `start`.
    radial_terms : int
        Coefficients of radial distortion.
    """
    if lens[RADIAL] == EQUIDISTANT:
        found = scaled_lens(start, lens)
        return replace(found, model=LensModel.EQUIDISTANT, D=np.zeros(4))
    r = radius * np.linspace(1.0 / _FIT_RADII, 1.0, _FIT_RADII)
    x = undistorted(np.stack([r, np.zeros_like(r)], -1), lens)[0][:, 0]
    powers = x[:, None] ** (1 + 2 * np.arange(radial_terms + 1))
    scale, *bent = np.linalg.lstsq(powers, r, rcond=None)[0]
    K, D = start.K.copy(), np.zeros(5)
    K[[0, 1], [0, 1]] *= scale
    D[:radial_terms] = np.array(bent) / scale
    return replace(start, K=K, D=D)


def scaled_lens(start: Intrinsics, lens: Float64Array) -> Intrinsics:
    """Return a lens with another focal length and the same distortion."""
    K = start.K.copy()
    K[[0, 1], [0, 1]] *= np.exp(lens[LOG_FOCAL])
    return replace(start, K=K)
