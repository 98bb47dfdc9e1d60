"""The unit of length, from several cues with their uncertainties."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.bundle.covariance import CENTRE_ROWS, largest_stddev, rows_of
from stcalib_ros.core.bundle.scaled_system import propagate
from stcalib_ros.core.geometry.lens import bearings
from stcalib_ros.core.geometry.triangulation import triangulate, unit_rays
from stcalib_ros.core.lifting.body_size import pose_size
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.model.rejection import Remark, RemarkCode
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.model.scale_cues import Distance
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.output.gravity import leg_length
from stcalib_ros.core.output.limits import (
    MAX_RAY_MISS,
    MAX_SCALE_SIGMA,
    MAX_SIZE_RATIO,
    USUAL_SIZE_RATIO,
)

LEG_FRACTION = 0.491
"""Length of thigh and shank over body height: 0.245 and 0.246 (Drillis and Contini, 1966)."""
_LEG_FRACTION_STDDEV = 0.04
"""Standard deviation of its logarithm: proportions of people, and where layouts put hips and
ankles. Chosen; not verified on real recordings."""
_MIN_LENGTH = 1e-12
"""Distance of two cameras; keeps cameras at one place from dividing by zero."""
_MIN_DEPTH = 1e-9
"""Distance along a ray; keeps a point in a camera from dividing by zero."""


@dataclass(frozen=True, slots=True)
class ScaleCue:
    """Estimate of the unit of length from one source.

    Attributes
    ----------
    source : str
        Name of the source for messages.
    metres : float
        Length of the unit.
    stddev : float
        Standard deviation as a fraction of it.
    """

    source: str
    metres: float
    stddev: float


@dataclass(frozen=True, slots=True)
class Scale:
    """Length of the unit of an adjustment, metres, and its stddev as a fraction of it."""

    metres: float
    stddev: float


class InconsistentScale(Exception):
    """Two cues contradict each other, or one of them is impossible; the message names them."""


def fuse(cues: Sequence[ScaleCue]) -> Scale | None:
    """Return the weighted mean of the logarithms of the cues; None without cues.

    Raises
    ------
    InconsistentScale
        Two cues differ by more than `limits.MAX_SCALE_SIGMA` standard deviations.
    """
    if not cues:
        return None
    for i, one in enumerate(cues):
        for other in cues[:i]:
            difference = abs(np.log(one.metres / other.metres))
            if difference > MAX_SCALE_SIGMA * np.hypot(one.stddev, other.stddev):
                raise InconsistentScale(
                    f"{other.source} and {one.source} contradict each other: lengths by the one "
                    f"are {other.metres / one.metres:.2f} times those by the other"
                )
    weight = np.array([cue.stddev**-2 for cue in cues])
    mean = weight @ np.log([cue.metres for cue in cues]) / weight.sum()
    return Scale(float(np.exp(mean)), float(weight.sum() ** -0.5))


def by_height(
    layout: Layout, people: Sequence[Float64Array], *, height_m: float, sigma_m: float
) -> ScaleCue | None:
    """Estimate the unit of length from the legs of people of a known mean height.

    Parameters
    ----------
    layout : Layout
    people : sequence of (K, J, 3) ndarray
        Joints in the unit of the adjustment; NaN where unknown.
    height_m, sigma_m : float
        Mean height of such people, and standard deviation of the height of one of them.

    References
    ----------
    R. Drillis, R. Contini, "Body segment parameters", New York University, 1966.
    """
    legs = [leg for joints in people if np.isfinite(leg := leg_length(layout, joints))]
    if not legs:
        return None
    height = float(np.mean(legs)) / LEG_FRACTION
    own = sigma_m / height_m / np.sqrt(len(legs))
    return ScaleCue(
        "scale.body_height_m", height_m / height, float(np.hypot(own, _LEG_FRACTION_STDDEV))
    )


def compared_with_adults(
    skeleton: Skeleton, people: Sequence[Float64Array], metres: float
) -> Remark | None:
    """Compare the size of people, by a length that was given, with that of adults.

    Parameters
    ----------
    skeleton : Skeleton
    people : sequence of (K, J, 3) ndarray
        Joints in the unit of the adjustment; NaN where unknown.
    metres : float
        Length of the unit by what was given.

    Returns
    -------
    Remark or None
        Where their size is unusual.

    Raises
    ------
    InconsistentScale
        Hardly anybody is of that size.
    """
    body = (skeleton.directions, skeleton.adult_lengths)
    sizes = [size for joints in people if np.isfinite(size := pose_size(joints, *body))]
    if not sizes:
        return None
    size = metres * float(np.median(sizes))
    off = abs(np.log(size))
    if off > np.log(MAX_SIZE_RATIO):
        raise InconsistentScale(
            f"by scale.distances, people are {size:.2f} times as large as adults, between "
            f"{1.0 / MAX_SIZE_RATIO:.2f} and {MAX_SIZE_RATIO:.2f} is the limit: check metres, and "
            "the cameras or points that they are between; if these are children, give their "
            "scale.body_height_m"
        )
    if off > np.log(USUAL_SIZE_RATIO):
        return Remark(RemarkCode.PEOPLE_OF_UNUSUAL_SIZE, (), {"ratio": size})
    return None


def by_distance(
    distance: Distance, recording: Recording, rig: Rig, covariance: Float64Array
) -> ScaleCue | None:
    """Estimate the unit of length from a known distance; None without its cameras.

    Parameters
    ----------
    distance : Distance
    recording : Recording
    rig : Rig
    covariance : (7 C, 7 C) ndarray
        Covariance of the rig, see `pose_covariance`.

    Raises
    ------
    InconsistentScale
        The two cameras are at one place, or the rays to a point miss each other.
    """
    position = {recording.cameras[c].name: i for i, c in enumerate(rig.cameras)}
    if not set(distance.names) <= set(position):
        return None
    source = f"the distance of {distance.metres:g} m {_between(distance)}"
    if distance.cameras:
        i, j = (position[name] for name in distance.cameras)
        length, stddev = _distance_of(rig, i, j, covariance)
    else:
        ends = _ends(distance, recording, rig, position)
        length, stddev = float(np.linalg.norm(ends[1] - ends[0])), 0.0
    if not length > 0:
        raise InconsistentScale(f"{source}: the two are at one place")
    relative = np.hypot(distance.sigma_m / distance.metres, stddev / length)
    return ScaleCue(source, distance.metres / length, float(relative))


def _between(distance: Distance) -> str:
    what = "between" if distance.cameras else "seen by"
    return f"{what} {' and '.join(distance.names)}"


def _distance_of(rig: Rig, i: int, j: int, covariance: Float64Array) -> tuple[float, float]:
    """Return the distance of two cameras and its standard deviation."""
    line = rig.t_ref_cam[j] - rig.t_ref_cam[i]
    length = float(np.linalg.norm(line))
    gradient = np.zeros(len(covariance))
    gradient[rows_of(j)[CENTRE_ROWS]] = line / max(length, _MIN_LENGTH)
    gradient[rows_of(i)[CENTRE_ROWS]] = -line / max(length, _MIN_LENGTH)
    return length, largest_stddev(propagate(gradient[None], covariance))


def _ends(
    distance: Distance, recording: Recording, rig: Rig, position: Mapping[str, int]
) -> Float64Array:
    """Triangulate both points (2, 3) in the frame of the reference camera."""
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
    missed = np.linalg.norm(line - along * rays, axis=-1) / np.maximum(along[..., 0], _MIN_DEPTH)
    if not (good.all() and (missed < MAX_RAY_MISS).all()):
        names = ", ".join(points)
        raise InconsistentScale(
            f"scale.distances: the points given for {names} do not meet: check their pixels"
        )
    return np.asarray(ends)
