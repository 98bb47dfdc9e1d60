"""The corrections of a lens as unknowns of the adjustment.

A lens images the point u of the plane z = 1 at ``K d(u)``. To correct its focal length by a ratio
moves the image by ``d``, so that it looks as if the point had moved by ``J^-1 d``, with the
derivative J of d; the principal point moves it by ``J^-1 e``, a coefficient of radial distortion
by ``J^-1`` times its derivative of d.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from stcalib_ros.core.bundle.lenses import CENTRE_X, CENTRE_Y, FOCAL, RADIAL, Lenses
from stcalib_ros.core.bundle.parameters import Cameras, CameraUnknown, ParameterLayout
from stcalib_ros.core.bundle.point_views import PointView
from stcalib_ros.core.model.arrays import Float64Array

_TINY = 1e-12
"""Square on the plane z = 1. Of a point at the axis. Numerical: avoids a division by zero."""


def _moved(along: Float64Array, depth: Float64Array) -> Float64Array:
    """Displacements (..., C, 1, 3, P) of points by those (..., C, 2, P) of their images."""
    out = np.zeros((*along.shape[:-2], 1, 3, along.shape[-1]))
    out[..., 0, :2, :] = along * depth[..., None, :]
    return out


def _by_focal_length(view: PointView) -> Float64Array:
    at = view.on_plane
    return _moved(at.u * (at.lens.gain / at.lens.slope)[..., None, :], at.depth)


def _by_centre(axis: int, view: PointView) -> Float64Array:
    at = view.on_plane
    u, across = at.u, 1.0 / at.lens.gain
    square = np.maximum(at.lens.r**2, _TINY)
    along = u * (u[..., axis, :] / square * (1.0 / at.lens.slope - across))[..., None, :]
    along[..., axis, :] += across
    return _moved(along, at.depth)


def _by_radial(n: int, view: PointView) -> Float64Array:
    at = view.on_plane
    return _moved(at.u * (at.lens.by_coefficient(n) / at.lens.slope)[..., None, :], at.depth)


def _unknown(
    row: int,
    name: str,
    unit: str,
    displacements: Callable[[PointView], Float64Array],
    *,
    of_lens: bool = True,
) -> CameraUnknown:
    return CameraUnknown(
        name, unit, relative=False, of_lens=of_lens, row=row, displacements=displacements
    )


LENS_UNKNOWNS = (
    _unknown(FOCAL, "focal", "ratio", _by_focal_length),
    _unknown(CENTRE_X, "centre_x", "focal length", partial(_by_centre, 0), of_lens=False),
    _unknown(CENTRE_Y, "centre_y", "focal length", partial(_by_centre, 1), of_lens=False),
    _unknown(RADIAL, "k1", "1", partial(_by_radial, 1)),
    _unknown(RADIAL + 1, "k2", "1", partial(_by_radial, 2)),
)
"""By the rows of the corrections of `Lenses`."""


def layout_of(n_cameras: int, lenses: Lenses | None, *, synchronised: bool) -> ParameterLayout:
    """Return the unknowns of every adjustment: poses, time offsets, and lenses that are not given.

    Parameters
    ----------
    n_cameras : int
    lenses : Lenses or None
    synchronised : bool
        The clocks are known to agree.
    """
    layout = ParameterLayout(n_cameras, synchronised)
    if lenses is None:
        return layout
    for unknown, free in zip(LENS_UNKNOWNS, lenses.free, strict=True):
        layout = layout.with_unknown(unknown, free)
    return replace(layout, group=lenses.group)


def corrections(cameras: Cameras) -> Float64Array:
    """Return the corrections (5, C) of the lenses of cameras."""
    return np.stack([cameras.value(unknown) for unknown in LENS_UNKNOWNS])
