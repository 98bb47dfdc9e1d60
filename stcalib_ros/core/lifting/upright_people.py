"""Focal length of one camera by the people who stand and walk upright before it.

Ankles, hips and shoulders of a person who is upright are above each other at heights that stay the
same. Over one floor, three such points of one pose determine those of all others by the direction
of the vertical, the heights over that of the camera, and the focal length: lines along the bodies
meet in the vertical vanishing point, and how people grow as they come near gives the horizon (Lv,
Zhao and Nevatia, 2002; Krahnstoever and Mendonca, 2005). All of it is fitted at once, with the
place of every pose on the floor as unknowns that are eliminated, since ankles have errors as well.

The camera has to be tilted: the error of the focal length grows as the square of the tilt becomes
small. Nobody is upright to the degree. A pose is off by a lean and by a bent knee, and goes on to
be for as long as the person stays where they are; the standard deviation counts places, not images.

In scenes of benchmarks.accuracy.level whose focal lengths are not known, it says something of a
fifth to a half of the cameras (nine of ten where everybody walks), off by 6 to 17 % (rms), and by
no more than three standard deviations. The lens is taken to be free of distortion: with k1 = -0.25
at 108 degrees, and with equidistant lenses of 125, it says something of a quarter, off by 6 to 8 %,
since people are near the middle of the image most of the time.

References
----------
F. Lv, T. Zhao and R. Nevatia, "Camera calibration from video of a walking human", PAMI 2006.
N. Krahnstoever and P. Mendonca, "Bayesian autocalibration for surveillance", ICCV 2005.
X. Fei, H. Wang, L. L. Cheong, X. Zeng, M. Wang and J. Tighe, "Single view physical distance
estimation using human pose", ICCV 2021.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.lifting.limits import (
    MAX_FOCAL_STDDEV,
    MAX_LEG_BEND_RAD,
    MAX_LOG_FOCAL,
    MAX_POSTURE_ERROR,
    MAX_TRUNK_BEND_RAD,
    MIN_CAMERA_TILT_RAD,
    MIN_UPRIGHT_PLACES,
    NEW_PLACE,
    NEW_PLACE_S,
    UPRIGHT_PROPORTION,
)
from stcalib_ros.core.lifting.upright_fit import FIRST_TILTS, POINTS, UprightFit, UprightPostures
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack
from stcalib_ros.core.model.skeleton import Skeleton

_SIDES = ("left", "right")
_LEG = ("ankle", "knee", "hip")
_MAX_POSES = 150
"""Poses that are fitted, about. Numerical: bounds the cost; they are far from independent."""
_MAX_TRACKS = 12
"""Tracks that are fitted, those with most upright poses. Numerical: bounds the cost."""


@dataclass(frozen=True, slots=True)
class FocalPrior:
    """What upright people say about the focal length of a camera.

    Attributes
    ----------
    log_ratio : float
        Logarithm of the focal length over that of `LiftedCamera.intrinsics`.
    stddev : float
        Its standard deviation.
    """

    log_ratio: float
    stddev: float


def focal_length_prior(camera: LiftedCamera, skeleton: Skeleton) -> FocalPrior | None:
    """Return the focal length by upright people; None where they do not determine it.

    The principal point and the distortion are taken to be those of `LiftedCamera.intrinsics`.

    Parameters
    ----------
    camera : LiftedCamera
    skeleton : Skeleton
    """
    postures = _upright_postures(camera, skeleton)
    if postures is None:
        return None
    place = _places(postures)
    if place[-1] + 1 < MIN_UPRIGHT_PLACES:
        return None
    fit = _fitted(postures)
    if fit is None:
        return None
    log_ratio, tilt, _ = (float(value) for value in fit.at.common)
    if not abs(tilt) >= MIN_CAMERA_TILT_RAD or not abs(log_ratio) <= MAX_LOG_FOCAL:
        return None
    stddev = fit.focal_stddev(place)
    return FocalPrior(log_ratio, stddev) if stddev <= MAX_FOCAL_STDDEV else None


def _fitted(postures: UprightPostures) -> UprightFit | None:
    """Return the first fit with errors of people who are upright."""
    for tilt in FIRST_TILTS:
        fit = UprightFit(postures, tilt)
        fit.run()
        if fit.scale <= MAX_POSTURE_ERROR**2:
            return fit
    return None


def _upright_postures(camera: LiftedCamera, skeleton: Skeleton) -> UprightPostures | None:
    """Return the poses of a camera that are upright by their own limbs, thinned out."""
    names = skeleton.layout.joint_names
    joints = {f"{side}_{joint}" for side in _SIDES for joint in (*_LEG, "shoulder")}
    if not joints <= set(names):
        return None
    at = {name: names.index(name) for name in joints}
    upright = [(track, _is_upright(track, at)) for track in camera.tracks]
    upright = sorted(upright, key=lambda one: -int(one[1].sum()))[:_MAX_TRACKS]
    some = [track[good] for track, good in upright if good.any()]
    if not some:
        return None
    x = np.concatenate([track.x for track in some]).astype(np.float64)
    person = np.repeat(np.arange(len(some)), [len(track.frames) for track in some])
    time_s = np.concatenate([camera.stamps[track.frames] for track in some])
    stride = max(1, len(x) // _MAX_POSES)
    x, person, time_s = x[::stride], person[::stride], time_s[::stride]
    points = np.stack([_middle(x, at, joint) for joint in POINTS], 1)
    ankles = x[:, [at[f"{side}_ankle"] for side in _SIDES]]
    _, person = np.unique(person, return_inverse=True)
    return UprightPostures(points, ankles, person, time_s)


def _is_upright(track: LiftedTrack, at: dict[str, int]) -> BoolArray:
    """Whether trunk and legs of each pose (F,) of a track are nearly in line."""
    x = track.x.astype(np.float64)
    ankle, hip, shoulder = (_middle(x, at, joint) for joint in POINTS)
    good = _angle(hip - ankle, shoulder - hip) < MAX_TRUNK_BEND_RAD
    for side in _SIDES:
        foot, knee, top = (x[:, at[f"{side}_{joint}"]] for joint in _LEG)
        good &= _angle(knee - foot, top - knee) < MAX_LEG_BEND_RAD
    trunk, legs = np.linalg.norm(shoulder - hip, axis=-1), np.linalg.norm(hip - ankle, axis=-1)
    low, high = UPRIGHT_PROPORTION
    return np.asarray(good & (trunk > low * legs) & (trunk < high * legs))


def _middle(x: Float64Array, at: dict[str, int], joint: str) -> Float64Array:
    return 0.5 * (x[:, at[f"left_{joint}"]] + x[:, at[f"right_{joint}"]])


def _angle(a: Float64Array, b: Float64Array) -> Float64Array:
    """Angle between vectors (F, 2) of the image, rad; NaN where one of them is not known."""
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return np.asarray(np.abs(np.arctan2(cross, (a * b).sum(-1))))


def _places(postures: UprightPostures) -> IntArray:
    """Number the places (N,) at which people are, one after the other, in the order of the poses.

    Somebody is at another place after a while, and if they have moved.
    """
    size = np.linalg.norm(postures.points[:, -1] - postures.points[:, 0], axis=-1)
    middle, person, time_s = postures.points.mean(1), postures.person, postures.time_s
    place = np.zeros(len(size), dtype=np.int64)
    since = 0
    for i in range(1, len(size)):
        moved = max(
            float(np.linalg.norm(middle[i] - middle[since])) / size[since],
            abs(float(np.log(size[i] / size[since]))),
        )
        later = time_s[i] - time_s[since] >= NEW_PLACE_S
        is_new = person[i] != person[since] or (later and moved > NEW_PLACE)
        since = i if is_new else since
        place[i] = place[i - 1] + is_new
    return place
