"""Points as cameras see them: what the displacements by the unknowns of cameras depend on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stcalib_ros.core.bundle.lenses import Lenses
from stcalib_ros.core.bundle.limits import NEAREST
from stcalib_ros.core.geometry.radial import RadialPoint
from stcalib_ros.core.model.arrays import Float32Array, Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class PointTimes:
    """What the time of a keypoint depends on; both broadcast to (..., C, P).

    Attributes
    ----------
    since_s : ndarray
        Time after the middle of the recording, s.
    row : ndarray
        Row of the keypoint in its image, px, from the row that the time of the image is of.
    """

    since_s: Float64Array
    row: Float32Array | Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class PlanePoints:
    """Points on the planes z = 1 of their cameras.

    Attributes
    ----------
    u : (..., 2, P) ndarray
    depth : (..., P) ndarray
    lens : RadialPoint
        Distortion there.
    """

    u: Float64Array
    depth: Float64Array
    lens: RadialPoint


@dataclass(frozen=True, eq=False)
class PointView:
    """Points as cameras see them.

    Attributes
    ----------
    y, velocity : (..., 3, P) ndarray
        Points and their velocities, turned into the axes of the cameras.
    Z : (..., 3, P) ndarray
        Points in the frames of the cameras.
    times : PointTimes
    lenses : Lenses or None
        None where all are given.
    """

    y: Float64Array
    velocity: Float64Array
    Z: Float64Array
    times: PointTimes
    lenses: Lenses | None = None

    @cached_property
    def on_plane(self) -> PlanePoints:
        """Where the lenses of the cameras see the points."""
        if self.lenses is None:
            raise TypeError("lenses of the cameras are needed")
        depth = np.maximum(self.Z[..., 2, :], NEAREST)
        u = self.Z[..., :2, :] / depth[..., None, :]
        at = self.lenses.profile.at(np.sqrt(u[..., 0, :] ** 2 + u[..., 1, :] ** 2))
        return PlanePoints(u, depth, at)
