"""The unit of length: what says how long a metre is, each with its own uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.bundle.covariance import CENTRE_ROWS, largest_stddev, rows_of
from stcalib_ros.core.bundle.scaled_system import propagate
from stcalib_ros.core.geometry.lens import bearings
from stcalib_ros.core.geometry.triangulation import triangulate, unit_rays
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.model.scale_cues import Distance
from stcalib_ros.core.output.gravity import leg_length

LEG_SHARE = 0.491
"""Thigh and shank over body height (Drillis and Contini, 1966)."""
_LEG_SHARE_STDDEV = 0.04
"""Of its logarithm: proportions of people, and where layouts put hips and ankles."""
_CONFLICT = 4.0
"""Standard deviations of the difference beyond which two sources contradict each other."""
_MISS = 0.05
"""Lines of sight to one point that pass each other by more of the distance are wrong."""


@dataclass(frozen=True, slots=True)
class ScaleCue:
    """What one source says of the unit of length.

    Attributes
    ----------
    source : str
        In words.
    metres : float
        Length of the unit.
    stddev : float
        As a share of it.
    """

    source: str
    metres: float
    stddev: float


@dataclass(frozen=True, slots=True)
class Scale:
    """Length of the unit of an adjustment, metres, and its deviation as a share of it."""

    metres: float
    stddev: float


class InconsistentScale(Exception):
    """Two sources that cannot both be right; the message names them."""


def fuse(claims: Sequence[ScaleCue]) -> Scale | None:
    """Weighted mean of the logarithms; None without claims.

    Raises
    ------
    InconsistentScale
        Two claims differ by more than four standard deviations of their difference.
    """
    if not claims:
        return None
    for i, one in enumerate(claims):
        for other in claims[:i]:
            apart = abs(np.log(one.metres / other.metres))
            if apart > _CONFLICT * np.hypot(one.stddev, other.stddev):
                raise InconsistentScale(
                    f"{other.source} and {one.source} contradict each other: lengths by the one "
                    f"are {other.metres / one.metres:.2f} times those by the other"
                )
    weight = np.array([claim.stddev**-2 for claim in claims])
    mean = weight @ np.log([claim.metres for claim in claims]) / weight.sum()
    return Scale(float(np.exp(mean)), float(weight.sum() ** -0.5))


def by_height(
    layout: Layout, people: Sequence[Float64Array], *, height_m: float, sigma_m: float
) -> ScaleCue | None:
    """Unit of length by the usual height of the people, from their legs.

    Parameters
    ----------
    layout : Layout
    people : sequence of (K, J, 3) ndarray
        In the unit of the adjustment; NaN where unknown.
    height_m, sigma_m : float
        Mean height of such people, and how far it may be off for one of them.
    """
    legs = [leg for joints in people if np.isfinite(leg := leg_length(layout, joints))]
    if not legs:
        return None
    height = float(np.mean(legs)) / LEG_SHARE
    own = sigma_m / height_m / np.sqrt(len(legs))
    return ScaleCue(
        "scale.body_height_m", height_m / height, float(np.hypot(own, _LEG_SHARE_STDDEV))
    )


def by_distance(
    distance: Distance, recording: Recording, rig: Rig, covariance: Float64Array
) -> ScaleCue | None:
    """Unit of length by a known distance; None if a camera of it is not calibrated.

    Parameters
    ----------
    distance : Distance
    recording : Recording
    rig : Rig
    covariance : (7 C, 7 C) ndarray
        Of the rig, as `pose_covariance` gives it.

    Raises
    ------
    InconsistentScale
        The two cameras are at one place, or the lines of sight to a point do not meet.
    """
    position = {recording.cameras[c].name: i for i, c in enumerate(rig.cameras)}
    if not set(distance.names) <= set(position):
        return None
    source = f"the distance of {distance.metres:g} m {_between(distance)}"
    if distance.cameras:
        i, j = (position[name] for name in distance.cameras)
        apart, stddev = _apart(rig, i, j, covariance)
    else:
        ends = _ends(distance, recording, rig, position)
        apart, stddev = float(np.linalg.norm(ends[1] - ends[0])), 0.0
    if not apart > 0:
        raise InconsistentScale(f"{source}: the two are at one place")
    relative = np.hypot(distance.sigma_m / distance.metres, stddev / apart)
    return ScaleCue(source, distance.metres / apart, float(relative))


def _between(distance: Distance) -> str:
    what = "between" if distance.cameras else "seen by"
    return f"{what} {' and '.join(distance.names)}"


def _apart(rig: Rig, i: int, j: int, covariance: Float64Array) -> tuple[float, float]:
    """Distance of two cameras and its standard deviation."""
    line = rig.t_ref_cam[j] - rig.t_ref_cam[i]
    length = float(np.linalg.norm(line))
    gradient = np.zeros(len(covariance))
    gradient[rows_of(j)[CENTRE_ROWS]] = line / max(length, 1e-12)
    gradient[rows_of(i)[CENTRE_ROWS]] = -line / max(length, 1e-12)
    return length, largest_stddev(propagate(gradient[None], covariance))


def _ends(
    distance: Distance, recording: Recording, rig: Rig, position: Mapping[str, int]
) -> Float64Array:
    """Both points (2, 3) in the frame of the reference camera."""
    points = distance.points or {}
    rows = [position[name] for name in points]
    cameras = [recording.cameras[rig.cameras[i]] for i in rows]
    b = np.stack(
        [
            bearings(np.array(ends, dtype=float), camera.intrinsics)[0]
            for camera, ends in zip(cameras, points.values(), strict=True)
        ],
        axis=1,
    )
    rays = np.einsum("cij,ncj->nci", rig.R_ref_cam[rows], unit_rays(b))
    centres = np.broadcast_to(rig.t_ref_cam[rows], rays.shape)
    ends, good = triangulate(centres, rays, np.ones(rays.shape[:2]))
    line = ends[:, None] - centres
    along = (line * rays).sum(-1, keepdims=True)
    missed = np.linalg.norm(line - along * rays, axis=-1) / np.maximum(along[..., 0], 1e-9)
    if not (good.all() and (missed < _MISS).all()):
        names = ", ".join(points)
        raise InconsistentScale(
            f"scale.distances: the points given for {names} do not meet: check their pixels"
        )
    return np.asarray(ends)
