"""The unknowns of the adjustment, and their initialization."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from stcalib_ros.core.bundle.lens_unknowns import layout_of
from stcalib_ros.core.bundle.lenses import Lenses
from stcalib_ros.core.bundle.observations import Observations, blocks_of
from stcalib_ros.core.bundle.parameters import Cameras, CameraUnknown, ParameterLayout
from stcalib_ros.core.geometry.local_polynomial import local_motion, smooth_motion
from stcalib_ros.core.geometry.triangulation import triangulate, unit_rays
from stcalib_ros.core.model.arrays import BoolArray, Float32Array, Float64Array, IntArray
from stcalib_ros.core.model.rig import Rig

_HALF_WINDOW_S = 0.2
"""Seconds. Half window of the local fit that velocities are read from. Measured on the scenes
"default" of benchmarks.accuracy.level: longer ones lose the motion of the feet."""

_MIN_HALF_WINDOW = 6
"""Time bins. Shortest such window: a polynomial of that fit needs them. Numerical."""


@dataclass(frozen=True, slots=True, eq=False)
class BundleState:
    """Unknowns of the adjustment.

    Attributes
    ----------
    R_cam_ref : (C, 3, 3) ndarray
    t_cam_ref : (C, 3) ndarray
        ``x_cam = R_cam_ref @ x_ref + t_cam_ref``; those of the reference are fixed.
    shift_s : (C,) ndarray
        Correction of the offsets that `Observations.phi` was computed with.
    X : (N, J, 3) ndarray
        Joints at the time bins in the reference frame.
    V, A : (N, J, 3) ndarray
        Velocities and accelerations, per second and squared second.
    inlier : (N, C, J) ndarray of bool
        Observations that take part.
    synchronised : bool
        The clocks are known to agree: `shift_s` is zero and no unknown.
    further : mapping of CameraUnknown to (C,) ndarray
        Values of further unknowns of the cameras; 0 where missing.
    lenses : Lenses or None
        By which the keypoints were undistorted; None where all are given.
    """

    R_cam_ref: Float64Array
    t_cam_ref: Float64Array
    shift_s: Float64Array
    X: Float64Array
    V: Float64Array
    A: Float64Array
    inlier: BoolArray
    synchronised: bool = False
    further: Mapping[CameraUnknown, Float64Array] = field(default_factory=dict)
    lenses: Lenses | None = None

    @property
    def cameras(self) -> Cameras:
        """The cameras alone."""
        return Cameras(self.R_cam_ref, self.t_cam_ref, self.shift_s, self.further, self.lenses)

    @property
    def layout(self) -> ParameterLayout:
        """Layout of poses, time offsets, and lenses that are not given."""
        return layout_of(len(self.t_cam_ref), self.lenses, synchronised=self.synchronised)

    def triangulated(self) -> BoolArray:
        """Points (N, J) that two cameras or more determine."""
        return triangulated(self.inlier)

    def with_inliers(self, used: BoolArray) -> BundleState:
        """The same with other inliers (N, C, J), but for points that one camera has alone."""
        return replace(self, inlier=used & triangulated(used)[:, None])

    def with_cameras(self, cameras: Cameras) -> BundleState:
        """The same with other cameras."""
        return replace(
            self,
            R_cam_ref=cameras.R,
            t_cam_ref=cameras.t,
            shift_s=cameras.shift,
            further=cameras.further,
        )

    def scaled(self, factor: float) -> BundleState:
        """The state of a scene that is larger by a factor."""
        names = ("t_cam_ref", "X", "V", "A")
        return replace(self, **{name: getattr(self, name) * factor for name in names})

    def in_reference_frame(self) -> BundleState:
        """The same in the frame of the reference camera, if that has turned against it."""
        R = self.R_cam_ref[0]
        if np.array_equal(R, np.eye(3)):
            return self
        turned = {name: getattr(self, name) @ R.T for name in ("R_cam_ref", "X", "V", "A")}
        turned["R_cam_ref"][0] = np.eye(3)
        return replace(self, **turned)

    def only(self, rows: IntArray | BoolArray) -> BundleState:
        """The same with some rows only."""
        names = ("X", "V", "A", "inlier")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})


def triangulated(used: BoolArray) -> BoolArray:
    """Points (N, J) with inliers (N, C, J) in two cameras or more."""
    return np.asarray(used.sum(1) >= 2)


def initial_state(obs: Observations, rig: Rig) -> BundleState:
    """Triangulate everything with the poses of a rig and estimate the velocities.

    Done twice: the second time every ray starts where the motion since the time bin puts it.
    """
    R_cam_ref = np.swapaxes(rig.R_ref_cam, -1, -2).copy()
    t_cam_ref = -np.einsum("cij,cj->ci", R_cam_ref, rig.t_ref_cam)
    N, _, J = obs.observed.shape
    V, A = np.zeros((2, N, J, 3))
    for _ in range(2):
        X, good = _triangulated(obs, rig, V, A)
        V, A = estimate_motion(obs, X, good)
    shift_s, used = np.zeros(len(R_cam_ref)), obs.observed & good[:, None, :]
    return BundleState(
        *(R_cam_ref, t_cam_ref, shift_s, X, V, A, used, rig.synchronised), lenses=obs.lenses
    )


def _triangulated(
    obs: Observations, rig: Rig, V: Float64Array, A: Float64Array
) -> tuple[Float64Array, BoolArray]:
    """Joints (N, J, 3) where rays that start as far on as the joints have moved come closest."""
    N, _, J = obs.observed.shape
    X, good = np.zeros((N, J, 3)), np.zeros((N, J), dtype=bool)
    for rows in blocks_of(obs):
        when = obs.elapsed(rows).transpose(0, 2, 1)[..., None]
        moved = when * (V[rows, :, None] + 0.5 * when * A[rows, :, None])
        weight = obs.observed[rows].transpose(0, 2, 1).astype(float)
        found, good[rows] = triangulate(
            rig.t_ref_cam - moved, _rays(obs.x[rows], rig), weight, refinements=1
        )
        X[rows] = np.where(good[rows, :, None], found, 0.0)
    return X, good


def _rays(x: Float32Array, rig: Rig) -> Float64Array:
    """Unit rays (N, J, C, 3) of image points (N, C, J, 2) in the reference frame."""
    turned = unit_rays(x) @ np.swapaxes(rig.R_ref_cam, -1, -2)
    return np.asarray(turned.transpose(0, 2, 1, 3))


def estimate_motion(
    obs: Observations, X: Float64Array, present: BoolArray, *, smooth_s: float = 0.0
) -> tuple[Float64Array, Float64Array]:
    """Velocities and accelerations (N, J, 3) by a local fit along each person's time bins.

    Of noisy points with `smooth_s`: by cubics over so many seconds to either side.
    """
    half_window = motion_half_window(obs, smooth_s)
    fit = smooth_motion if smooth_s else local_motion
    V, A = np.zeros((2, *X.shape))
    for rows in person_rows_of(obs):
        time_bins = obs.time_bin[rows] - obs.time_bin[rows][0]
        n = int(time_bins[-1]) + 1
        path, there = np.zeros((n, *X.shape[1:])), np.zeros((n, X.shape[1]), dtype=bool)
        path[time_bins], there[time_bins] = X[rows], present[rows]
        per_step, per_step2 = fit(path, there, half_window=half_window)
        V[rows], A[rows] = per_step[time_bins] / obs.step_s, per_step2[time_bins] / obs.step_s**2
    return V, A


def motion_half_window(obs: Observations, smooth_s: float = 0.0) -> int:
    """Time bins to either side that `estimate_motion` fits."""
    return max(_MIN_HALF_WINDOW, round((smooth_s or _HALF_WINDOW_S) / obs.step_s))


def person_rows_of(obs: Observations) -> Iterator[slice]:
    """Rows of one person after the other."""
    edges = np.flatnonzero(np.diff(obs.person)) + 1
    bounds = [0, *edges.tolist(), len(obs.person)]
    for begin, end in pairwise(bounds):
        if end > begin:
            yield slice(begin, end)
