"""Unit and frame of the result: metres where the scale is known, and upright if asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from stcalib_ros.core.bundle.covariance import (
    CENTRE_ROWS,
    PARAMETERS,
    ROTATION_ROWS,
    with_known_distance,
)
from stcalib_ros.core.bundle.gauge import spread
from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.limits import MIN_UNIT_BASELINE
from stcalib_ros.core.bundle.scaled_system import propagate
from stcalib_ros.core.geometry.so3 import hat
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.options import Options
from stcalib_ros.core.output.gravity import GravityFrame, find_upright, heading_axis
from stcalib_ros.core.output.scale import (
    InconsistentScale,
    Scale,
    ScaleCue,
    by_distance,
    by_height,
    compared_with_adults,
    fuse,
)
from stcalib_ros.core.reconstruction.people import joint_paths
from stcalib_ros.core.validation.cross_view import depth_scale

_BLOCK_S = 1.0
"""Seconds in which every walking person puts a foot down: one step takes about half of that."""


@dataclass(frozen=True, slots=True, eq=False)
class WorldAlignment:
    """Scale, orientation and height of the result.

    Attributes
    ----------
    unit : float
        Factor from lengths of the adjustment to those of the result.
    metric : bool
        Whether lengths of the result are metres.
    scale_stddev : float
        Relative standard deviation of lengths; NaN if not metric.
    upright : GravityFrame, optional
        Frame of the result, in the unit of the adjustment; default: that of the reference camera.
    rejection : Rejection, optional
        Why the result is not to be used.
    remarks : tuple of Remark
        What is unusual about the scale.
    """

    unit: float
    metric: bool = False
    scale_stddev: float = float("nan")
    upright: GravityFrame | None = None
    rejection: Rejection | None = None
    remarks: tuple[Remark, ...] = ()

    @property
    def R(self) -> Float64Array:
        """Rotation (3, 3) from the frame of the reference camera to that of the result."""
        return np.eye(3) if self.upright is None else self.upright.R_world_ref

    def to_result(self, points: Float64Array) -> Float64Array:
        """Return points (..., 3) of the adjustment in the frame and unit of the result."""
        height = 0.0 if self.upright is None else self.upright.height
        return np.asarray(self.unit * (points @ self.R.T + [0.0, 0.0, height]))

    def covariance_of(self, rig: Rig, covariance: Float64Array) -> Float64Array:
        """Return the joint covariance (7 C, 7 C) in the frame and unit of the result.

        The uncertainty of the vertical and of the floor moves all cameras together, the reference
        camera included. The unit counts as known, and so does the distance between the
        first two cameras.

        Parameters
        ----------
        rig : Rig
        covariance : (7 C, 7 C) ndarray
            Covariance in the frame of the reference camera, as `pose_covariance` returns it.
        """
        C = len(rig.cameras)
        G = block_diag(*[self.unit * self.R, self.R, np.eye(1)] * C)
        first, second = first_two(rig)
        known = with_known_distance(covariance, rig.t_ref_cam, first, second)
        moved = propagate(G, known)
        if self.upright is None:
            return np.asarray(moved)
        J = np.concatenate([self._common_motion(t) for t in rig.t_ref_cam])
        return np.asarray(moved + J @ self.upright.covariance @ J.T)

    def _common_motion(self, t_ref_cam: Float64Array) -> Float64Array:
        """Derivative (7, 3) of a camera by the tilt about x and y and the height of the frame."""
        heading = self.R @ heading_axis(self.R)
        # The reference camera keeps its heading along x: tilt about x turns about z, too.
        turn = np.array([[1.0, 0.0], [0.0, 1.0], [heading[2] / heading[0], 0.0]])
        J = np.zeros((len(PARAMETERS), 3))
        J[CENTRE_ROWS, :2] = -self.unit * hat(self.R @ t_ref_cam) @ turn
        J[CENTRE_ROWS.start + 2, 2] = self.unit
        J[ROTATION_ROWS, :2] = turn
        return J


def place(
    recording: Recording,
    cameras: Sequence[LiftedCamera],
    skeleton: Skeleton,
    last: Iteration,
    covariance: Float64Array,
    options: Options,
) -> WorldAlignment:
    """Find unit and frame of the result.

    Parameters
    ----------
    recording : Recording
    cameras : sequence of LiftedCamera
        All cameras of the recording.
    skeleton : Skeleton
    last : Iteration
    covariance : (7 C, 7 C) ndarray
        Covariance of the cameras of the rig.
    options : Options
    """
    people = tuple(joint_paths(last))
    rejection, scale, remark = None, None, None
    try:
        scale = _scale(recording, cameras, skeleton, last, covariance, people, options)
        if scale is not None and options.scale.distances and not options.scale.body_height_m > 0:
            remark = compared_with_adults(skeleton, people, scale.metres)
    except InconsistentScale as why:
        rejection = Rejection(RejectionReason.INCONSISTENT_SCALE, detail=str(why))
    upright = None
    if options.world_frame:
        block = max(1, round(_BLOCK_S / last.observations.step_s))
        upright, why_not = find_upright(skeleton.layout, people, block=block)
        if upright is None:
            rejection = rejection or Rejection(RejectionReason.NO_VERTICAL, detail=why_not)
    if scale is None:
        return WorldAlignment(baseline_unit(last.rig), upright=upright, rejection=rejection)
    remarks = () if remark is None else (remark,)
    return WorldAlignment(scale.metres, True, scale.stddev, upright, rejection, remarks)


def baseline_unit(rig: Rig) -> float:
    """Return the factor that makes the distance between the first two cameras 1.

    Where they are practically at one place: the spread of all cameras.
    """
    first, second = first_two(rig)
    length = float(np.linalg.norm(rig.t_ref_cam[second] - rig.t_ref_cam[first]))
    all_of_them = spread(rig.t_ref_cam)
    return 1.0 / (length if length >= MIN_UNIT_BASELINE * all_of_them else all_of_them)


def first_two(rig: Rig) -> tuple[int, int]:
    """Return the positions in the rig of its first two cameras in the order of the recording."""
    first, second = np.argsort(rig.cameras, kind="stable")[:2].tolist()
    return first, second


def _scale(
    recording: Recording,
    cameras: Sequence[LiftedCamera],
    skeleton: Skeleton,
    last: Iteration,
    covariance: Float64Array,
    people: Sequence[Float64Array],
    options: Options,
) -> Scale | None:
    """Return the unit of the adjustment in metres; None if nothing determines it.

    Metric 3D poses count only where they agree with what the user gave.

    Raises
    ------
    InconsistentScale
        Lengths that the user gave contradict each other.
    """
    scale = options.scale
    given = [by_distance(d, recording, last.rig, covariance) for d in scale.distances]
    if scale.body_height_m > 0:
        given.append(
            by_height(
                skeleton.layout,
                people,
                height_m=scale.body_height_m,
                sigma_m=scale.body_height_sigma_m,
            )
        )
    cues = [cue for cue in given if cue is not None]
    by_user = fuse(cues)
    lifted = [c for c in (recording.cameras[i] for i in last.rig.cameras) if c.has_3d_poses]
    if not lifted or not all(camera.metric for camera in lifted):
        return by_user
    poses = ScaleCue("the metric 3D poses", depth_scale(cameras, last), scale.poses_sigma)
    try:
        return fuse([*cues, poses])
    except InconsistentScale:
        return by_user
