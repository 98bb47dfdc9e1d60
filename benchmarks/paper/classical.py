"""Table IV: two cameras by the eight-point algorithm and by PnP, all by structure from motion."""

from __future__ import annotations

import cv2
import numpy as np

from benchmarks.paper.boards import CORNERS, SQUARE_M, BoardShots
from benchmarks.paper.point_bundle import PointViews, rig_of, triangulated
from benchmarks.paper.sfm import as_pose
from stcalib_ros.core.geometry.alignment import best_rotation
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.synthetic import SceneRig


def eight_point(shots: BoardShots, a: int, b: int) -> RelativePose:
    """Essential matrix of all corners of a pair by the normalised eight-point algorithm.

    Hartley 1997. The corners lie on several planes, so that the linear problem is regular. The
    algorithm knows no lengths: t is scaled so that the squares of the boards have their size.
    """
    rows = shots.for_pair(a, b)
    x_a = shots.views.x[rows, a].reshape(-1, 2)
    x_b = shots.views.x[rows, b].reshape(-1, 2)
    F, _ = cv2.findFundamentalMat(x_b, x_a, cv2.FM_8POINT)
    U, _, Vt = np.linalg.svd(F)
    E = U @ np.diag([1.0, 1.0, 0.0]) @ Vt
    _, R, t, _ = cv2.recoverPose(E, x_b, x_a, np.eye(3))
    R_a_b, t_a_b = as_pose(R, t)
    pair = shots.views.of([a, b])
    pair = PointViews(pair.x[rows], pair.observed[rows], pair.focal)
    X = triangulated(pair, rig_of(np.stack([np.eye(3), R_a_b]), np.stack([np.zeros(3), t_a_b]))).X
    return RelativePose(a, b, R_a_b, t_a_b * SQUARE_M / _square(X), 0.0, (), float(len(rows)))


def _square(X: Float64Array) -> float:
    """Median length (of N, J, 3) of the sides of the squares."""
    grid = X.reshape(len(X), *CORNERS, 3)
    sides = [np.linalg.norm(np.diff(grid, axis=k), axis=-1).ravel() for k in (1, 2)]
    return float(np.median(np.concatenate(sides)))


def pnp(shots: BoardShots, rig: SceneRig, a: int, b: int) -> RelativePose:
    """Pose of every board in both cameras, and the mean of the relative poses.

    OpenCV's planar solver (IPPE) followed by Levenberg-Marquardt on the reprojection error; of
    the relative poses of the boards the rotations are averaged in the chordal sense, the
    translations by their median.
    """
    R_a_b, t_a_b = [], []
    for board in shots.for_pair(a, b):
        (R_a, t_a), (R_b, t_b) = (_board_pose(shots, rig, int(board), c) for c in (a, b))
        R_a_b.append(R_a @ R_b.T)
        t_a_b.append(t_a - R_a_b[-1] @ t_b)
    R = best_rotation(np.sum(R_a_b, axis=0))
    return RelativePose(a, b, R, np.median(t_a_b, axis=0), 0.0, (), float(len(R_a_b)))


def _board_pose(
    shots: BoardShots, rig: SceneRig, board: int, c: int
) -> tuple[Float64Array, Float64Array]:
    """``x_cam = R x_board + t``, metres."""
    lens = rig.intrinsics[c]
    flags = (cv2.SOLVEPNP_IPPE, cv2.SOLVEPNP_ITERATIVE)
    _, r, t = cv2.solvePnP(
        shots.corners_board, shots.pixels[board, c], lens.K, lens.D, flags=flags[0]
    )
    _, r, t = cv2.solvePnP(
        shots.corners_board,
        shots.pixels[board, c],
        lens.K,
        lens.D,
        rvec=r,
        tvec=t,
        useExtrinsicGuess=True,
        flags=flags[1],
    )
    return as_pose(cv2.Rodrigues(r)[0], t)
