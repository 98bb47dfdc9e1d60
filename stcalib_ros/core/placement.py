"""Unit and frame of the result: metres if something says how long one is, upright if asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from stcalib_ros.core.agreement import depth_scale
from stcalib_ros.core.averaging import Rig
from stcalib_ros.core.geometry import hat
from stcalib_ros.core.lift import LiftedCamera
from stcalib_ros.core.options import Options
from stcalib_ros.core.reconstruction import joint_paths
from stcalib_ros.core.rounds import Round
from stcalib_ros.core.scale import Claim, Contradiction, Scale, by_distance, by_height, fuse
from stcalib_ros.core.skeleton import Skeleton
from stcalib_ros.core.types import FloatArray, Recording
from stcalib_ros.core.upright import Upright, find_upright

_BLOCK_S = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """How the result lies in the world.

    Attributes
    ----------
    unit : float
        Factor from lengths of the adjustment to those of the result.
    metric : bool
        The result's lengths are metres.
    scale_stddev : float
        Of a metre, as a share; NaN if not metric.
    upright : Upright or None
        Frame of the result, in the unit of the adjustment; None: that of the reference camera.
    complaint : str
        Why the result is not to be used; empty if it is.
    """

    unit: float
    metric: bool = False
    scale_stddev: float = float("nan")
    upright: Upright | None = None
    complaint: str = ""

    @property
    def R(self) -> FloatArray:
        """Rotation (3, 3) from the frame of the reference camera to that of the result."""
        return np.eye(3) if self.upright is None else self.upright.R_world_ref

    def to_result(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) of the adjustment in the frame and unit of the result."""
        height = 0.0 if self.upright is None else self.upright.height
        return np.asarray(self.unit * (points @ self.R.T + [0.0, 0.0, height]))

    def covariance_of(self, rig: Rig, covariance: FloatArray) -> FloatArray:
        """Joint covariance (7 C, 7 C) in the frame and unit of the result.

        What is not known of the direction of up and of the floor moves all cameras together, and
        the reference camera, too. The unit counts as known.

        Parameters
        ----------
        rig : Rig
        covariance : (7 C, 7 C) ndarray
            As `pose_covariance` gives it.
        """
        C = len(rig.cameras)
        G = block_diag(*[self.unit * self.R, self.R, np.eye(1)] * C)
        moved = G @ covariance @ G.T
        if self.upright is None:
            return np.asarray(moved)
        J = np.concatenate([self._common_motion(t) for t in rig.t_ref_cam])
        return np.asarray(moved + J @ self.upright.covariance @ J.T)

    def _common_motion(self, t_ref_cam: FloatArray) -> FloatArray:
        """Derivative (7, 3) of a camera by the tilt about x and y and the height of the frame."""
        forward = self.R[:, 2]
        # The reference camera goes on looking along x: tilt about x turns about z, too.
        turn = np.array([[1.0, 0.0], [0.0, 1.0], [forward[2] / max(forward[0], 1e-3), 0.0]])
        J = np.zeros((7, 3))
        J[:3, :2] = -self.unit * hat(self.R @ t_ref_cam) @ turn
        J[2, 2] = self.unit
        J[3:6, :2] = turn
        return J


def place(
    recording: Recording,
    cameras: Sequence[LiftedCamera],
    skeleton: Skeleton,
    last: Round,
    covariance: FloatArray,
    options: Options,
) -> Placement:
    """Find unit and frame of the result.

    Parameters
    ----------
    recording : Recording
    cameras : sequence of LiftedCamera
        All cameras of the recording.
    skeleton : Skeleton
    last : Round
    covariance : (7 C, 7 C) ndarray
        Of the rig of the round.
    options : Options
    """
    people = tuple(joint_paths(last))
    complaint, scale = "", None
    try:
        scale = _scale(recording, cameras, skeleton, last, covariance, people, options)
    except Contradiction as why:
        complaint = str(why)
    upright = None
    if options.world_frame:
        block = max(1, round(_BLOCK_S / last.observations.step_s))
        upright, why_not = find_upright(skeleton.layout, people, block=block)
        if upright is None:
            complaint = complaint or f"world_frame: {why_not}; leave it empty, or have people walk"
    if scale is None:
        return Placement(baseline_unit(last.rig), upright=upright, complaint=complaint)
    return Placement(scale.metres, True, scale.stddev, upright, complaint)


def baseline_unit(rig: Rig) -> float:
    """Factor that makes the distance between the first two cameras 1."""
    first, second = np.argsort(rig.cameras, kind="stable")[:2]
    return 1.0 / float(np.linalg.norm(rig.t_ref_cam[second] - rig.t_ref_cam[first]))


def _scale(
    recording: Recording,
    cameras: Sequence[LiftedCamera],
    skeleton: Skeleton,
    last: Round,
    covariance: FloatArray,
    people: Sequence[FloatArray],
    options: Options,
) -> Scale | None:
    """Length of the unit of the adjustment.

    3D poses that are said to be metric are believed only as far as they agree with what was
    given on purpose.

    Raises
    ------
    Contradiction
        What was given contradicts itself.
    """
    o = options.scale
    given = [by_distance(d, recording, last.rig, covariance) for d in o.distances]
    if o.body_height_m > 0:
        given.append(
            by_height(
                skeleton.layout, people, height_m=o.body_height_m, sigma_m=o.body_height_sigma_m
            )
        )
    claims = [claim for claim in given if claim is not None]
    by_choice = fuse(claims)
    if not all(recording.cameras[c].metric for c in last.rig.cameras):
        return by_choice
    poses = Claim("the metric 3D poses", depth_scale(cameras, last), o.poses_sigma)
    try:
        return fuse([*claims, poses])
    except Contradiction:
        return by_choice
