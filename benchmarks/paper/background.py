"""Points of the background and their matches, the input of structure from motion.

There are no images. Points lie on the walls and the floor of a room around the cameras; a camera
that sees one detects it with a pixel of noise, and two cameras match it with a probability that
falls with the angle between their views, as descriptors do (SIFT: half of the matches are gone
at about 25 degrees, nearly all at 50; Mikolajczyk and Schmid 2005). Some matches are false.
"""

from __future__ import annotations

import numpy as np

from benchmarks.paper.point_bundle import PointViews
from stcalib_ros.core.geometry.lens import bearings
from stcalib_ros.core.geometry.visibility import project_visible
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.synthetic import SceneRig

N_POINTS = 4000
"""Number of points on walls and floor."""
SIGMA_PX = 1.0
"""Standard deviation of a detected point, px per axis."""
FALSE_FRACTION = 0.2
"""Fraction of matches that are false."""
HALF_MATCHED_RAD = np.deg2rad(25.0)
"""Angle between two views at which half of the detections match, rad."""
_WALL_M = 1.5
"""Distance of the walls beyond the cameras, m."""


def background_views(rng: np.random.Generator, rig: SceneRig) -> PointViews:
    """Matched background points of all cameras, false matches among them."""
    points = room_points(rng, rig, N_POINTS)
    C = len(rig.names)
    x = np.zeros((N_POINTS, C, 1, 2))
    seen = np.zeros((N_POINTS, C), dtype=bool)
    for c in range(C):
        pixels = project_visible(
            points @ rig.R_cam_world[c].T + rig.t_cam_world[c], rig.intrinsics[c]
        )
        pixels = pixels + SIGMA_PX * rng.standard_normal(pixels.shape)
        there, _ = bearings(pixels, rig.intrinsics[c])
        seen[:, c] = np.isfinite(there).all(-1)
        x[seen[:, c], c, 0] = there[seen[:, c]]
    seen &= _matched(rng, points, rig, seen)
    _mismatch(rng, x, seen)
    focal = np.array([np.sqrt(lens.K[0, 0] * lens.K[1, 1]) for lens in rig.intrinsics])
    return PointViews(np.where(seen[:, :, None, None], x, 0.0), seen[:, :, None], focal)


def room_points(rng: np.random.Generator, rig: SceneRig, n: int) -> Float64Array:
    """Points (n, 3) on four walls beyond the cameras and on the floor."""
    reach = np.abs(rig.centres_world[:, :2]).max() + _WALL_M
    u, v = rng.uniform(-reach, reach, (2, n))
    height = rng.uniform(0.0, 3.5, n)
    side = rng.integers(5, size=n)
    wall = np.where(side % 2 == 0, 1.0, -1.0) * reach
    x = np.where(side < 2, wall, u)
    y = np.where(side < 2, v, np.where(side < 4, wall, v))
    return np.stack([x, y, np.where(side < 4, height, 0.0)], axis=-1)


def _matched(
    rng: np.random.Generator, points: Float64Array, rig: SceneRig, seen: BoolArray
) -> BoolArray:
    """Detections of a point that match at least one other detection of it."""
    rays = points[:, None] - rig.centres_world
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    angle = np.arccos(np.clip(np.einsum("nca,nda->ncd", rays, rays), -1, 1))
    likely = np.exp(-np.log(2.0) * (angle / HALF_MATCHED_RAD) ** 2)
    hit = rng.uniform(size=angle.shape) < likely
    hit &= seen[:, :, None] & seen[:, None] & ~np.eye(seen.shape[1], dtype=bool)
    return np.asarray((hit | hit.transpose(0, 2, 1)).any(-1))


def _mismatch(rng: np.random.Generator, x: Float64Array, seen: BoolArray) -> None:
    """Exchange the detections of some points with those of others, camera by camera."""
    for c in range(seen.shape[1]):
        rows = np.flatnonzero(seen[:, c])
        wrong = rows[rng.uniform(size=len(rows)) < FALSE_FRACTION]
        x[wrong, c] = x[rng.permutation(wrong), c]
