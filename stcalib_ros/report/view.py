"""A room seen from above and aside, in perspective."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.report.room import Room

_ELEVATIONS = np.radians([20.0, 26.0, 32.0, 38.0, 46.0])
_AZIMUTHS = np.radians(np.arange(0.0, 360.0, 5.0))
_DISTANCE = 3.0
"""From the middle, in radii of the scene."""
_FRUSTUM = 0.11
"""Depth of a frustum, in the extent of the cameras."""
_NAME = np.array([0.09, 0.06])
"""How far the middle of a name is from what it names, in the height of the page."""
_NAME_WIDTH = 0.16
_NEAR = 0.03
"""Gap on the page that is too narrow, in its height."""
_STEEP = 1.5
"""How many touching objects a view straight from above is worth."""
_PAGE = 1.4
"""Width of the page over its height."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A viewpoint.

    Attributes
    ----------
    R : (3, 3) ndarray
        Rows are right, up and towards the viewer.
    middle : (3,) ndarray
        What is looked at.
    distance : float
    """

    R: Float64Array
    middle: Float64Array
    distance: float

    def project(self, points: Float64Array) -> Float64Array:
        """Positions (..., 2) on the page, y up, of points (..., 3) of the room."""
        p = (points - self.middle) @ self.R.T
        return np.asarray(p[..., :2] * (self.distance / (self.distance - p[..., 2:])))

    def nearness(self, points: Float64Array) -> float:
        """Larger for what is nearer to the viewer and has to be drawn later."""
        return float(np.nanmean((points - self.middle) @ self.R[2]))


def frustum_depth(room: Room) -> float:
    """How deep frusta are drawn."""
    centres = np.array([camera.centre for camera in room.cameras])
    return _FRUSTUM * float(np.linalg.norm(np.ptp(centres, axis=0)))


def crown(joints: Float64Array) -> Float64Array:
    """Point (3,) over the middle of a person, as high as the highest of the joints (N, 3)."""
    return np.append(joints[:, :2].mean(0), joints[:, 2].max())


def best_view(room: Room) -> View:
    """View from the side that keeps cameras and people apart on the page."""
    outlines = _outlines(room)
    points = np.concatenate([outline.points for outline in outlines])
    middle = (points.max(0) + points.min(0)) / 2.0
    radius = max(float(np.linalg.norm(points - middle, axis=-1).max()), 1e-6)
    views = [
        View(_axes(azimuth, elevation), middle, _DISTANCE * radius)
        for azimuth, elevation in product(_AZIMUTHS, _ELEVATIONS)
    ]
    return max(views, key=lambda view: _clearness(view, outlines))


@dataclass(frozen=True, slots=True, eq=False)
class _Outline:
    """Some points (N, 3) of something, and away from which its name will stand."""

    points: Float64Array
    top: Float64Array
    away_from: Float64Array


def _outlines(room: Room) -> list[_Outline]:
    depth = frustum_depth(room)
    outlines = []
    for camera in room.cameras:
        image = camera.frustum(depth)
        outlines.append(_Outline(np.vstack([image, camera.centre]), camera.centre, image.mean(0)))
    for person in room.people:
        joints = person.joints[:, np.isfinite(person.joints).all(-1).any(0)]
        if joints.size:
            points = np.nanmedian(joints, axis=0)
            top = crown(points)
            outlines.append(_Outline(points, top, top - [0.0, 0.0, 1.0]))
    return outlines


def _axes(azimuth: float, elevation: float) -> Float64Array:
    level, up = np.cos(elevation), np.sin(elevation)
    towards = np.array([np.cos(azimuth) * level, np.sin(azimuth) * level, up])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.stack([right, np.cross(towards, right), towards])


def _clearness(view: View, outlines: list[_Outline]) -> float:
    """How far objects are from one another on the page; from low down people look taller."""
    pages = [view.project(outline.points) for outline in outlines]
    extent = np.ptp(np.concatenate(pages), axis=0)
    height = max(float(extent[0]) / _PAGE, float(extent[1]))
    named = [
        np.vstack([page, _name(view, outline, height)])
        for page, outline in zip(pages, outlines, strict=True)
    ]
    gaps = [np.linalg.norm(a[:, None] - b[None], axis=-1).min() for a, b in combinations(named, 2)]
    crowded = float(np.exp(-np.array(gaps) / (_NEAR * height)).sum())
    return -crowded - _STEEP * float(view.R[2, 2])


def _name(view: View, outline: _Outline, height: float) -> Float64Array:
    """Ends of the name on the page, (2, 2)."""
    top, below = view.project(np.array([outline.top, outline.away_from]))
    direction = (top - below) / max(float(np.linalg.norm(top - below)), 1e-9)
    middle = top + height * _NAME * direction
    return np.asarray(middle + height * _NAME_WIDTH * np.array([[-0.5, 0.0], [0.5, 0.0]]))
