"""Bundle adjustment of static points, with which every baseline is refined.

It is the adjustment of the package (`stcalib_ros.core.bundle.levenberg_marquardt`) with velocities
of zero, so that the rows of a table differ in what they start from and in what was matched, not in
the solver.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.levenberg_marquardt import adjust
from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.residuals import errors_px
from stcalib_ros.core.bundle.state import BundleState, initial_state
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.model.rig import Rig


@dataclass(frozen=True, slots=True, eq=False)
class PointViews:
    """Image points of N groups of J static points in C cameras.

    Attributes
    ----------
    x : (N, C, J, 2) ndarray
        On the plane z = 1; 0 where not seen.
    seen : (N, C, J) ndarray of bool
    focal : (C,) ndarray
        Pixels per unit of x.
    """

    x: Float64Array
    observed: BoolArray
    focal: Float64Array

    def of(self, cameras: list[int]) -> PointViews:
        """The same seen by some of the cameras."""
        return PointViews(self.x[:, cameras], self.observed[:, cameras], self.focal[cameras])

    def observations(self) -> Observations:
        """In the form that the adjustment of the package takes."""
        N, C, J = self.observed.shape
        return Observations(
            person=np.arange(N),
            time_bin=np.zeros(N, dtype=np.int64),
            track=np.zeros((N, C), dtype=np.int64),
            phi=np.zeros((N, C)),
            x=self.x,
            focal=np.broadcast_to(self.focal[:, None], (N, C, J)).copy(),
            observed=self.observed,
            start_s=0.0,
            step_s=1.0,
        )


@dataclass(frozen=True, slots=True, eq=False)
class PointBundle:
    """Cameras and points after the adjustment.

    Attributes
    ----------
    rig : Rig
    X : (N, J, 3) ndarray
        Points in the frame of the first camera; 0 where unknown.
    known : (N, J) ndarray of bool
    mean_px, rms_px : float
        Reprojection errors of the inlier points, px.
    """

    rig: Rig
    X: Float64Array
    known: BoolArray
    mean_px: float
    rms_px: float


def rig_of(R_ref_cam: Float64Array, t_ref_cam: Float64Array) -> Rig:
    """Rig of cameras 0, 1, ..., all with one clock."""
    n = len(R_ref_cam)
    return Rig(np.arange(n), R_ref_cam, t_ref_cam, np.zeros(n), 0.0)


def triangulated(views: PointViews, rig: Rig) -> PointBundle:
    """Triangulate the points; nothing is adjusted."""
    o = views.observations()
    return _result(o, initial_state(o, rig), rig)


def adjusted(
    views: PointViews, rig: Rig, *, max_px: float | None = None, iterations: int = 30
) -> PointBundle:
    """Bundle adjustment of poses and points.

    Parameters
    ----------
    views : PointViews
    rig : Rig
        Start; the distance of the first two cameras is kept.
    max_px : float, optional
        Points that the start puts further off than this take no part.
    iterations : int
    """
    o = views.observations()
    state = initial_state(o, rig)
    if max_px is not None:
        with np.errstate(invalid="ignore"):
            good = o.observed & (errors_px(o, state) < max_px)
        state = replace(state, inlier=good & (good.sum(1) >= 2)[:, None])
    if not state.inlier.any():
        return _result(o, state, rig)
    state = adjust(o, state, iterations=iterations, tolerance=1e-3)
    R_ref_cam = np.swapaxes(state.R_cam_ref, -1, -2)
    t_ref_cam = 0.0 - np.einsum("cij,cj->ci", R_ref_cam, state.t_cam_ref)
    return _result(o, state, replace(rig, R_ref_cam=R_ref_cam, t_ref_cam=t_ref_cam))


def _result(o: Observations, state: BundleState, rig: Rig) -> PointBundle:
    errors = errors_px(o, state)
    used = errors[state.inlier & np.isfinite(errors)]
    mean = float(used.mean()) if len(used) else float("nan")
    rms = float(np.sqrt(np.mean(used**2))) if len(used) else float("nan")
    return PointBundle(rig, state.X, state.inlier.sum(1) >= 2, mean, rms)
