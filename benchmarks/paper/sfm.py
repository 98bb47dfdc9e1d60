"""Incremental structure from motion (Schoenberger and Frahm 2016), as far as few cameras need it.

Essential matrix of the pair with most verified matches at a fair angle, then one camera after
the other by PnP on the points known so far, new points triangulated and everything adjusted each
time. With several cameras and some thousand points this is what COLMAP's mapper does; the parts
that matter for long sequences (local adjustment, retriangulation, view graphs) are left out.
"""

from __future__ import annotations

from itertools import combinations

import cv2
import numpy as np

from benchmarks.paper.point_bundle import PointBundle, PointViews, adjusted, rig_of, triangulated
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.rig import Rig

_MIN_INLIERS = 30
"""Inlier matches that the first pair needs."""
_MIN_PNP_INLIERS = 15
"""Inlier points that a further camera needs."""
_MIN_ANGLE_RAD = np.deg2rad(5.0)
"""Smallest median triangulation angle of the first pair, rad."""
_RANSAC_PX = 4.0
"""Reprojection error up to which a match is an inlier, px."""


class SfmFailure(RuntimeError):
    """No first pair, or a camera that cannot be registered; the message says which."""


def incremental_sfm(views: PointViews, *, max_px: float = 4.0) -> PointBundle:
    """Poses of all cameras from matched points.

    Parameters
    ----------
    views : PointViews
        False matches among them.
    max_px : float
        Points that reproject worse are left out of the adjustments.

    Returns
    -------
    PointBundle
        Cameras and points in the frame of camera 0; unit: the distance of the first two cameras.

    Raises
    ------
    SfmFailure
    """
    done, R, t = _first_pair(views)
    n_cameras = views.observed.shape[1]
    order = list(done)
    bundle = adjusted(views.of(order), rig_of(R, t), max_px=max_px)
    while len(order) < n_cameras:
        counts = {
            c: int((bundle.known & views.observed[:, c]).sum())
            for c in range(n_cameras)
            if c not in order
        }
        camera = max(counts, key=lambda c: counts[c])
        R_new, t_new = _registered(views, bundle, camera)
        order.append(camera)
        rig = rig_of(
            np.concatenate([bundle.rig.R_ref_cam, R_new[None]]),
            np.concatenate([bundle.rig.t_ref_cam, t_new[None]]),
        )
        bundle = adjusted(views.of(order), rig, max_px=max_px)
    back = np.argsort(order)
    rig = _from_first(bundle.rig, back)
    return triangulated(views, rig)


def _first_pair(views: PointViews) -> tuple[tuple[int, int], Float64Array, Float64Array]:
    """Return the pair with most inliers among those with a large enough triangulation angle."""
    best: tuple[int, tuple[int, int], Float64Array, Float64Array] | None = None
    for a, b in combinations(range(views.observed.shape[1]), 2):
        found = essential(views, a, b)
        if found is None:
            continue
        n, R, t, angle = found
        if n >= _MIN_INLIERS and angle >= _MIN_ANGLE_RAD and (best is None or n > best[0]):
            best = (n, (a, b), R, t)
    if best is None:
        raise SfmFailure("no initial image pair")
    _, pair, R, t = best
    return pair, np.stack([np.eye(3), R]), np.stack([np.zeros(3), t])


def essential(
    views: PointViews, a: int, b: int
) -> tuple[int, Float64Array, Float64Array, float] | None:
    """Relative pose by RANSAC on the essential matrix.

    Returns
    -------
    n_inliers : int
    R_a_b : (3, 3) ndarray
    t_a_b : (3,) ndarray
        Unit length.
    angle : float
        Median angle at which the rays of the inliers meet, rad.
    """
    both = views.observed[:, a] & views.observed[:, b]
    x_a, x_b = views.x[:, a][both], views.x[:, b][both]
    if len(x_a) < _MIN_PNP_INLIERS:
        return None
    focal = float(np.sqrt(views.focal[a] * views.focal[b]))
    E, mask = cv2.findEssentialMat(
        x_b, x_a, np.eye(3), cv2.RANSAC, 0.9999, _RANSAC_PX / focal, maxIters=2000
    )
    if E is None or E.shape != (3, 3):
        return None
    n, R, t, mask = cv2.recoverPose(E, x_b, x_a, np.eye(3), mask=mask)
    inlier = mask.ravel() > 0
    rays = [np.column_stack([x, np.ones(len(x))])[inlier] for x in (x_a, x_b)]
    turned = rays[1] @ R.T
    cosine = (rays[0] * turned).sum(1) / (
        np.linalg.norm(rays[0], axis=1) * np.linalg.norm(turned, axis=1)
    )
    angle = float(np.median(np.arccos(np.clip(cosine, -1, 1)))) if n else 0.0
    return int(n), *as_pose(R, t), angle


def as_pose(R: object, t: object) -> tuple[Float64Array, Float64Array]:
    """Rotation (3, 3) and translation (3,) as OpenCV gives them, in our types."""
    return np.asarray(R, dtype=np.float64), np.asarray(t, dtype=np.float64).ravel()


def _registered(
    views: PointViews, bundle: PointBundle, camera: int
) -> tuple[Float64Array, Float64Array]:
    """Pose (R_ref_cam, t_ref_cam) of a new camera by PnP with RANSAC.

    SQPnP (Terzakis and Lourakis 2020): of points on one plane, as the floor is, OpenCV's EPnP
    returns the mirrored pose, which has them all behind the camera.
    """
    use = bundle.known & views.observed[:, camera]
    if use.sum() < _MIN_PNP_INLIERS:
        raise SfmFailure(f"camera {camera} sees {int(use.sum())} of the points known so far")
    threshold = _RANSAC_PX / float(views.focal[camera])
    ok, r, t, inliers = cv2.solvePnPRansac(
        bundle.X[use],
        views.x[:, camera][use],
        np.eye(3),
        None,
        iterationsCount=2000,
        reprojectionError=threshold,
        confidence=0.9999,
        flags=cv2.SOLVEPNP_SQPNP,
    )
    if not ok or inliers is None or len(inliers) < _MIN_PNP_INLIERS:
        raise SfmFailure(f"camera {camera} cannot be registered")
    R_cam_ref, t_cam_ref = as_pose(cv2.Rodrigues(r)[0], t)
    depth = bundle.X[use][inliers.ravel()] @ R_cam_ref[2] + t_cam_ref[2]
    if np.mean(depth > 0) < 0.5:
        raise SfmFailure(f"camera {camera} would look away from what it sees")
    return R_cam_ref.T, -R_cam_ref.T @ t_cam_ref


def _from_first(rig: Rig, order: IntArray) -> Rig:
    """Cameras in another order, in the frame of the first one; the first baseline is 1."""
    R, t = rig.R_ref_cam[order], rig.t_ref_cam[order]
    t = (t - t[0]) @ R[0]
    R = R[0].T @ R
    return rig_of(R, t / np.linalg.norm(t[1]))
