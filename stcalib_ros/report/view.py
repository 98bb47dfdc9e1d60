"""A room seen from above and aside, in perspective."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.types import FloatArray
from stcalib_ros.report.room import Room

_ELEVATION = np.radians(27.0)
_DISTANCE = 2.6
"""From the middle, in radii of the scene."""
_AZIMUTHS = 72


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A viewpoint: rows of `R` are right, up and towards the viewer.

    Attributes
    ----------
    R : (3, 3) ndarray
    middle : (3,) ndarray
        What is looked at.
    distance : float
    """

    R: FloatArray
    middle: FloatArray
    distance: float

    def project(self, points: FloatArray) -> FloatArray:
        """Positions (..., 2) on the page, y up, of points (..., 3) of the room."""
        p = (points - self.middle) @ self.R.T
        return np.asarray(p[..., :2] * (self.distance / (self.distance - p[..., 2:])))

    def nearness(self, points: FloatArray) -> float:
        """Larger for what is nearer to the viewer and has to be drawn later."""
        return float(np.nanmean((points - self.middle) @ self.R[2]))


def best_view(room: Room) -> View:
    """View from the side that keeps cameras and people apart on the page."""
    centres = np.array([camera.centre for camera in room.cameras])
    people = [np.nanmedian(person.joints, axis=(0, 1)) for person in room.people]
    points = np.array([*centres, *people])
    points = points[np.isfinite(points).all(-1)]
    middle = (points.max(0) + points.min(0)) / 2.0
    radius = float(np.linalg.norm(points - middle, axis=-1).max())
    views = [
        View(_axes(azimuth), middle, _DISTANCE * max(radius, 1e-6))
        for azimuth in np.arange(_AZIMUTHS) * 2.0 * np.pi / _AZIMUTHS
    ]
    return max(views, key=lambda view: _clearness(view, points))


def _axes(azimuth: float) -> FloatArray:
    towards = np.array(
        [
            np.cos(azimuth) * np.cos(_ELEVATION),
            np.sin(azimuth) * np.cos(_ELEVATION),
            np.sin(_ELEVATION),
        ]
    )
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.stack([right, np.cross(towards, right), towards])


def _clearness(view: View, points: FloatArray) -> float:
    """Smallest distance of two points on the page."""
    page = view.project(points)
    apart = np.linalg.norm(page[:, None] - page[None], axis=-1)
    return float(apart[~np.eye(len(page), dtype=bool)].min(initial=np.inf))
