"""The relative pose and clock offset of two cameras."""

from __future__ import annotations

from dataclasses import dataclass

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.rig import Rig


@dataclass(frozen=True, slots=True, eq=False)
class RelativePose:
    """One possible relation of two cameras.

    Attributes
    ----------
    a, b : int
        Indices of the cameras.
    R_a_b : (3, 3) ndarray
    t_a_b : (3,) ndarray
        ``x_a = R_a_b @ x_b + t_a_b``, metres by body size.
    lag_s : float
        ``t_b - t_a`` of the same time, seconds.
    matches : tuple of (int, int)
        Indices of tracks of a and b that are the same person.
    support : float
        Number of common keypoints that agree with it, weighted by how well.
    epipolar_px : float
        Median Sampson distance of the matched keypoints.
    """

    a: int
    b: int
    R_a_b: Float64Array
    t_a_b: Float64Array
    lag_s: float
    matches: tuple[tuple[int, int], ...]
    support: float
    epipolar_px: float = float("nan")


def relative_pose(
    rig: Rig, a: int, b: int, matches: tuple[tuple[int, int], ...] = ()
) -> RelativePose:
    """Return the relative pose of two cameras of a rig, given by their positions in it."""
    R_a = rig.R_ref_cam[a]
    return RelativePose(
        int(rig.cameras[a]),
        int(rig.cameras[b]),
        R_a.T @ rig.R_ref_cam[b],
        R_a.T @ (rig.t_ref_cam[b] - rig.t_ref_cam[a]),
        float(rig.offset_s[a] - rig.offset_s[b]),
        matches,
        0.0,
    )
