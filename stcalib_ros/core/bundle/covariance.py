"""Joint covariance of everything that is estimated, by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import block_diag

from stcalib_ros.core.bundle.gauge import spread
from stcalib_ros.core.bundle.levenberg_marquardt import Motion, cluster_scores
from stcalib_ros.core.bundle.limits import (
    CLUSTERS_PER_UNKNOWN,
    LONGEST_CLUSTER,
    MIN_UNIT_BASELINE,
    SHORTEST_CLUSTER,
)
from stcalib_ros.core.bundle.normal_equations import ReducedSystem
from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.offset_debiasing import VelocityNoise, velocity_noise
from stcalib_ros.core.bundle.parameters import (
    LINE_DELAY,
    ROTATION,
    TIME_OFFSET,
    TRANSLATION,
    Cameras,
    ParameterLayout,
)
from stcalib_ros.core.bundle.residuals import errors_px, robust_scale
from stcalib_ros.core.bundle.scaled_system import propagate
from stcalib_ros.core.bundle.state import BundleState, estimate_motion
from stcalib_ros.core.geometry.robust import CAUCHY, MIN_SCALE_PX
from stcalib_ros.core.geometry.so3 import hat
from stcalib_ros.core.model.arrays import BoolArray, Float32Array, Float64Array, IntArray

PARAMETERS = ("x", "y", "z", "rot_x", "rot_y", "rot_z", "time_offset_s")
"""Published parameters of a camera, in the order of their rows."""

CENTRE_ROWS, ROTATION_ROWS, POSE_ROWS, OFFSET_ROW = slice(0, 3), slice(3, 6), slice(0, 6), 6
"""Rows of one camera among its `PARAMETERS`."""


def rows_of(cameras: int | IntArray) -> IntArray:
    """Rows (..., 7) of cameras in a joint covariance of the `PARAMETERS`."""
    first = len(PARAMETERS) * np.asarray(cameras)
    return np.asarray(first[..., None] + np.arange(len(PARAMETERS)))


def with_known_distance(
    P: Float64Array, centres: Float64Array, first: int, second: int
) -> Float64Array:
    """Covariance (7 C, 7 C) where lengths are measured by the distance between two cameras.

    The scale of the scene follows this distance, which becomes certain. Unchanged where the two are
    practically at one place.

    Parameters
    ----------
    P : (7 C, 7 C) ndarray
        With any other length as the gauge.
    centres : (C, 3) ndarray
        In the unit of P; the reference is the origin.
    first, second : int
    """
    line = centres[second] - centres[first]
    length = float(np.linalg.norm(line))
    if length < MIN_UNIT_BASELINE * spread(centres):
        return P
    rows = rows_of(np.arange(len(centres)))[:, CENTRE_ROWS]
    by_distance = np.zeros(len(P))
    by_distance[rows[second]], by_distance[rows[first]] = line / length, -line / length
    J = np.eye(len(P))
    J[rows.ravel()] -= np.outer(centres.ravel() / length, by_distance)
    return propagate(J, P)


def largest_stddev(P: Float64Array) -> float:
    """Standard deviation along the direction that is known least; infinite if unobservable."""
    if not np.isfinite(P).all():
        return float("inf")
    return float(np.sqrt(max(np.linalg.eigvalsh(P)[-1], 0.0)))


@dataclass(frozen=True, slots=True, eq=False)
class EliminatedUnknown:
    """An unknown that the system of the cameras no longer holds.

    Attributes
    ----------
    conditional : (m, m) ndarray
        Its covariance if the cameras were known.
    gain : (m, n) ndarray
        Its derivative by the unknowns of the cameras, in the order of their layout.
    """

    conditional: Float64Array
    gain: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class JointCovariance:
    """Covariance of all unknowns by name, ``camera.unknown``.

    ``cam1.translation`` is the centre of the camera and ``cam1.rotation`` a rotation (rad) about
    the axes of the reference frame; ``cam1.time_offset`` (s) is that of row 0, and of the middle of
    the recording. The gauge is fixed: its rows are zero. An unknown that is not observable has an
    infinite variance.

    Attributes
    ----------
    cameras : tuple of str
        Names, the reference first.
    layout : ParameterLayout
    matrix : (n, n) ndarray
        In the parameters of the adjustment, in the order of the layout.
    published : (n, n) ndarray
        Derivative of the published parameters by those of the adjustment.
    eliminated : mapping of str to EliminatedUnknown
        Further unknowns by name.
    """

    cameras: tuple[str, ...]
    layout: ParameterLayout
    matrix: Float64Array
    published: Float64Array
    eliminated: Mapping[str, EliminatedUnknown] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all unknowns."""
        return (*self.layout.names(self.cameras), *self.eliminated)

    def block(self, *names: str) -> Float64Array:
        """Covariance of several unknowns, one after the other.

        Raises
        ------
        KeyError
            A name is not among `names`.
        """
        rows = [self._rows(name) for name in names]
        own = [
            self.eliminated[name].conditional
            if name in self.eliminated
            else np.zeros((len(part), len(part)))
            for name, part in zip(names, rows, strict=True)
        ]
        return propagate(np.concatenate(rows), self.matrix) + np.asarray(block_diag(*own))

    def covariance(self, one: str, other: str) -> Float64Array:
        """Covariance (m, n) of two unknowns."""
        m = len(self._rows(one))
        return self.block(one) if one == other else self.block(one, other)[:m, m:]

    def stddev(self, name: str) -> Float64Array:
        """Standard deviations (m,) of the components of an unknown."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.block(name)), 0.0)))

    def poses_and_offsets(self) -> Float64Array:
        """Covariance (7 C, 7 C) of the `PARAMETERS` of all cameras."""
        kept = [self.layout.columns(one) for one in (TRANSLATION, ROTATION, TIME_OFFSET)]
        rows = np.concatenate(kept, 1).ravel()
        return propagate(self.published[rows], self.matrix)

    def _rows(self, name: str) -> Float64Array:
        if name in self.eliminated:
            return self.eliminated[name].gain
        camera, _, unknown = name.rpartition(".")
        if camera not in self.cameras:
            raise KeyError(f"{name}: not among {', '.join(self.names)}")
        columns = self.layout.columns(self.layout.find(unknown))
        return np.asarray(self.published[columns[self.cameras.index(camera)]])


@dataclass(frozen=True, slots=True, eq=False)
class Information:
    """What the keypoints know of the unknowns of a layout, and how far that can be believed.

    Attributes
    ----------
    cameras : Cameras
    system : ReducedSystem
        At the optimum, without damping.
    scores : (n, K) ndarray
        Gradients of clusters of points that count as independent.
    curvature_lost : float
    noise : VelocityNoise or None
        Part of the system that is noise; None where it is of no interest.
    """

    cameras: Cameras
    system: ReducedSystem
    scores: Float64Array
    curvature_lost: float
    noise: VelocityNoise | None

    def covariance(self, layout: ParameterLayout) -> Float64Array:
        """Covariance (n, n) in the parameters of the adjustment.

        Parameters
        ----------
        layout : ParameterLayout
            With the columns of the system; other unknowns may be estimated.
        """
        variance = self.variance(layout)
        known, _ = layout.prior(self.cameras)
        P = layout.inverse(self.system.H / variance + np.diag(known), self.cameras)
        if self.noise is None:
            return P
        return P + self._due_to_noise(layout.held(), variance)

    def variance(self, layout: ParameterLayout) -> float:
        """Variance of independent keypoints that would know as little as these, px^2.

        By unknowns of which nothing was known before.
        """
        layout = layout.without_lenses()
        inverse = layout.inverse(self.system.H, self.cameras)
        inverse[np.isinf(inverse)] = 0.0
        U = self.scores
        found = float(np.einsum("an,ab,bn", U, inverse, U, optimize=True))
        return found / (layout.n_free() - 1) * self.curvature_lost**2

    def _due_to_noise(self, layout: ParameterLayout, variance: float) -> Float64Array:
        """Additional covariance of poses and offsets as noise is part of the system.

        As if further unknowns were known: along some of their combinations the keypoints know less
        than the noise is known to.
        """
        noise = self.noise
        if noise is None:
            return np.zeros_like(self.system.H)
        system = noise.subtract_from(self.system, layout, self.cameras.shift)
        with_it, without = (
            layout.inverse(H / variance, self.cameras) for H in (self.system.H, system.H)
        )
        return np.asarray(np.where(np.isinf(with_it), 0.0, without - with_it))


def information(
    obs: Observations,
    state: BundleState,
    layout: ParameterLayout | None = None,
    *,
    of_poses: bool = True,
    motion: Motion = estimate_motion,
) -> Information:
    """Sum up what the keypoints know of the unknowns of a layout.

    The covariance is that of the normal equations, the noise of the velocities subtracted, times
    one variance for all. A detector is off by the same few centimetres at a joint as long as it
    observes the person from that side: the gradients u_k of everything that is observed of one
    joint of one person over five seconds or so count as independent, and the variance is their
    ``sum_k u_k^T H^-1 u_k`` per unknown. A full covariance from the u_k would be too small: there
    are too few of them.

    Parameters
    ----------
    obs : Observations
    state : BundleState
        At the optimum.
    layout : ParameterLayout, optional
        Default: poses and time offsets.
    of_poses : bool
        Poses and offsets are of interest, which the noise of the velocities makes less certain.
    motion : callable
        How velocities were read.
    """
    layout = layout or state.layout
    cluster = clusters(obs, state.triangulated(), n_unknowns=layout.n_free())
    system, U = cluster_scores(obs, state, cluster, layout)
    errors = errors_px(obs, state)
    scale = CAUCHY * max(robust_scale(errors, state.inlier), MIN_SCALE_PX)
    lost = _curvature_lost(errors[state.inlier], scale)
    noisy = of_poses and not state.synchronised
    noise = velocity_noise(obs, state, scale, motion) if noisy else None
    return Information(state.cameras, system, U, lost, noise)


def pose_covariance(obs: Observations, state: BundleState) -> Float64Array:
    """Joint covariance of poses and time offsets at an optimum, as `information` describes it.

    The gauge is the pose and clock of the reference, whose rows are zero, and the spread of the
    centres.

    Parameters
    ----------
    obs : Observations
    state : BundleState
        At the optimum.

    Returns
    -------
    (7 C, 7 C) ndarray
        Per camera x, y, z of its centre, rotation about the fixed axes of the reference frame
        (rad) and offset (s).
    """
    names = tuple(str(c) for c in range(len(state.t_cam_ref)))
    P = information(obs, state).covariance(state.layout)
    published = publication(state.cameras, state.layout)
    return JointCovariance(names, state.layout, P, published).poses_and_offsets()


def _curvature_lost(errors: Float32Array, scale: float) -> float:
    """Ratio by which the robust cost is flatter than its weights make the normal equations.

    A weight ``w = 1 / (1 + r^2 / s^2)`` stands for a mean second derivative of w^2 in the plane.
    """
    weight = 1.0 / (1.0 + (errors[np.isfinite(errors)] / scale) ** 2)
    return float(weight.mean() / (weight**2).mean())


def clusters(obs: Observations, known: BoolArray, *, n_unknowns: int) -> IntArray:
    """Number (N, J) of the cluster of each joint: of one person over a span of time.

    The span is halved, down to a shortest one, while there are too few clusters of known joints.
    """
    J = obs.observed.shape[2]
    span = LONGEST_CLUSTER
    while True:
        keys = np.stack([obs.person, obs.time_bin // span], -1)
        _, stretch = np.unique(keys, axis=0, return_inverse=True)
        number = stretch.reshape(-1, 1) * J + np.arange(J)
        occupied, found = np.unique(number[known], return_inverse=True)
        enough = len(occupied) >= CLUSTERS_PER_UNKNOWN * n_unknowns
        if enough or span // 2 < SHORTEST_CLUSTER:
            break
        span //= 2
    cluster: IntArray = np.zeros(known.shape, dtype=np.int64)
    cluster[known] = found.ravel()
    return cluster


def publication(
    cameras: Cameras, layout: ParameterLayout, middle_row: Float64Array | None = None
) -> Float64Array:
    """Derivative (n, n) of the published parameters by those of the adjustment.

    Centre, rotation in the reference frame and offset of row 0 by rotation, translation and offset
    of the middle row; further unknowns are published as they are.

    Parameters
    ----------
    cameras : Cameras
    layout : ParameterLayout
    middle_row : (C,) ndarray, optional
        Rows that the times of images are of; needed where line delays are estimated.
    """
    J = np.eye(layout.size)
    rotation, translation = layout.columns(ROTATION), layout.columns(TRANSLATION)
    for c, (R, t) in enumerate(zip(cameras.R, cameras.t, strict=True)):
        J[np.ix_(translation[c], rotation[c])] = -R.T @ hat(t)
        J[np.ix_(translation[c], translation[c])] = -R.T
        J[np.ix_(rotation[c], rotation[c])] = -R.T
        if layout.turns_reference:
            J[np.ix_(translation[c], rotation[0])] += hat(R.T @ t)
            J[np.ix_(rotation[c], rotation[0])] += np.eye(3)
    if middle_row is not None and LINE_DELAY in layout.further:
        offset, line = layout.scalars(TIME_OFFSET), layout.scalars(LINE_DELAY)
        J[offset, line] -= middle_row
        J[offset, line[0]] += middle_row[0]
    return J
