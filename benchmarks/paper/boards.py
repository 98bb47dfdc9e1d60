"""Checkerboards held in front of pairs of cameras, as in the paper's Table IV."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.paper.point_bundle import PointViews
from stcalib_ros.core.geometry.lens import bearings
from stcalib_ros.core.geometry.visibility import project_visible
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.synthetic import SceneRig

CORNERS = (8, 6)
"""Columns and rows of inner corners of the checkerboard; the paper does not give them."""
SQUARE_M = 0.06
"""Side of a square, m; the paper does not give it."""
_GRAZING = 0.25
"""Least cosine between the normal and the view: flatter views are not detected in practice."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardShots:
    """Boards shown to pairs of cameras; at least two cameras observe each board.

    Attributes
    ----------
    pair : (B, 2) ndarray of int
        Pair of cameras that the board was shown to.
    corners_board : (J, 3) ndarray
        Corners in the frame of the board, metres.
    pixels : (B, C, J, 2) ndarray
        Corners with noise, px; NaN for cameras that do not see the whole board.
    views : PointViews
        The same points undistorted.
    """

    pair: IntArray
    corners_board: Float64Array
    pixels: Float64Array
    views: PointViews

    @property
    def observed(self) -> BoolArray:
        """Whether a camera observes a board, (B, C)."""
        return np.asarray(np.isfinite(self.pixels).all((2, 3)))

    def for_pair(self, a: int, b: int) -> IntArray:
        """Numbers of the boards that were held up for a pair of cameras."""
        return np.flatnonzero((self.pair == (a, b)).all(1))

    def of_pairs_only(self) -> PointViews:
        """Views without the cameras that happened to see a board of another pair."""
        keep = np.zeros_like(self.observed)
        np.put_along_axis(keep, self.pair, True, axis=1)
        seen = self.views.observed & keep[:, :, None]
        return PointViews(np.where(seen[..., None], self.views.x, 0.0), seen, self.views.focal)


def show_boards(
    rng: np.random.Generator,
    rig: SceneRig,
    *,
    per_pair: int = 10,
    sigma_px: float = 0.5,
    reach_m: float = 1.5,
) -> BoardShots:
    """Hold up boards at random where both cameras of a pair see all of them.

    A board is transparent, its corners can be seen from behind: no pair of opposite cameras
    would otherwise see one. Corners: 8 x 6, 60 mm spacing; the paper does not give it.

    Parameters
    ----------
    rng : Generator
    rig : SceneRig
        Cameras in a world with z up, people moving around the origin.
    per_pair : int
    sigma_px : float
        Noise of a corner, per axis.
    reach_m : float
        Boards are within this of the middle of the area.
    """
    flat = np.indices(CORNERS).reshape(2, -1).T * SQUARE_M
    corners = np.column_stack([flat - flat.mean(0), np.zeros(len(flat))])
    pairs, pixels = [], []
    for a in range(len(rig.names)):
        for b in range(a + 1, len(rig.names)):
            for _ in range(per_pair):
                pairs.append((a, b))
                pixels.append(_board_seen_by(rng, rig, (a, b), corners, reach_m))
    clean = np.stack(pixels)
    noisy = clean + sigma_px * rng.standard_normal(clean.shape)
    return BoardShots(np.array(pairs), corners, noisy, _undistorted(noisy, rig))


def _board_seen_by(
    rng: np.random.Generator,
    rig: SceneRig,
    pair: tuple[int, int],
    corners: Float64Array,
    reach: float,
) -> Float64Array:
    """Pixels (C, J, 2) of a random board observed by both cameras; NaN for the others."""
    while True:
        direction = rng.standard_normal(3)
        middle = reach * rng.uniform() ** (1 / 3) * direction / np.linalg.norm(direction)
        R_world_board = Rotation.random(random_state=rng).as_matrix()
        points = corners @ R_world_board.T + middle + [0.0, 0.0, 1.0]
        seen = np.stack(
            [_pixels(points, R_world_board[:, 2], rig, c) for c in range(len(rig.R_cam_world))]
        )
        if np.isfinite(seen[list(pair)]).all():
            return seen


def _pixels(points: Float64Array, normal: Float64Array, rig: SceneRig, c: int) -> Float64Array:
    ray = points.mean(0) - rig.centres_world[c]
    out = project_visible(points @ rig.R_cam_world[c].T + rig.t_cam_world[c], rig.intrinsics[c])
    facing = abs(normal @ ray) >= _GRAZING * np.linalg.norm(ray)
    return out if facing and np.isfinite(out).all() else np.full_like(out, np.nan)


def _undistorted(pixels: Float64Array, rig: SceneRig) -> PointViews:
    x = np.stack([bearings(pixels[:, c], rig.intrinsics[c])[0] for c in range(pixels.shape[1])], 1)
    seen: BoolArray = np.asarray(np.isfinite(x).all(-1))
    focal = np.array([np.sqrt(lens.K[0, 0] * lens.K[1, 1]) for lens in rig.intrinsics])
    return PointViews(np.where(seen[..., None], x, 0.0), seen, focal)
