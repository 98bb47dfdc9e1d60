"""Other forms of keypoint bias than a polynomial of the viewing direction.

Each form displaces the joints of one person, in the optical frame of the camera that observes them,
and but for "views" has the same constants in all cameras: they belong to detector and person.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.synthetic.detector import DetectorBias, displaced
from stcalib_ros.core.synthetic.skeleton import LAYOUT, N_JOINTS, PARENTS, body_axes

KeypointBias = Callable[[Float64Array], Float64Array]
"""Where a detector places joints (T, 17, 3) of a person, optical frame, metres."""

BIAS_FORMS = ("harmonic", "constant", "views", "hidden", "foreshortened", "sizes")
"""Forms of keypoint bias."""

_BEHIND_M = (0.02, 0.12)
"""Metres, range. Depth of a joint behind the axis of the body from which on it begins to be hidden
and is entirely hidden: about the half-thickness of a trunk. Chosen."""
_BESIDE_M = (0.15, 0.3)
"""Metres, range. Distance of a joint beside the axis of the body, in the image, within which it is
entirely hidden and from which on it is not: about the half-width of a trunk. Chosen."""
_EDGE_M = 0.05
"""Metres. Distance from the axis of the body at which a hidden joint is pulled mostly to the side
that it is nearer to. Chosen, so that the pull does not jump."""
_LARGEST_SIZE = 3.0
"""Ratio. Size of the largest bias of a person over the usual one; the smallest is the inverse.
Chosen: one person in loose clothes, one in tight ones."""
_HIDDEN_RMS = 0.25
"""Ratio. Root mean square, per axis across the line of sight and over all joints, of a bias of one
along one axis where a joint is hidden. Measured on the default scenes."""
_FORESHORTENED_RMS = 0.37
"""Ratio. Root mean square of the squared cosine between a bone and the line of sight, over all
joints. Measured on the default scenes; over all directions it would be sqrt(1 / 5)."""


def keypoint_bias(
    form: str,
    harmonic: np.random.Generator,
    other: np.random.Generator,
    rms_m: float,
    *,
    camera: int = 0,
) -> KeypointBias:
    """Return the bias of the keypoints of one person.

    Parameters
    ----------
    form : str
        One of `BIAS_FORMS`: "harmonic", a polynomial of the viewing direction (`DetectorBias`);
        "constant", the same displacement in the image for every view; "views", another one for
        each camera; "hidden", joints behind the trunk pulled to the nearer side of it;
        "foreshortened", growing with the square of the cosine between bone and line of sight;
        "sizes", harmonic, of another size for each person.
    harmonic, other : Generator
        Sources of the constants of the harmonic form, which are drawn with every form, and of the
        others.
    rms_m : float
        Root mean square per axis across the line of sight, metres.
    camera : int
        Index of the camera.
    """
    size = rms_m * (_size(other) if form == "sizes" else 1.0)
    usual = DetectorBias(harmonic, size)
    if form in ("constant", "views"):
        return _Constant(other, rms_m, view=camera if form == "views" else 0)
    if form == "hidden":
        return _Hidden(other, rms_m)
    if form == "foreshortened":
        return _Foreshortened(other, rms_m)
    return lambda joints_cam: displaced(joints_cam, usual)


def _size(rng: np.random.Generator) -> float:
    """Size of the biases of one person: log-uniform, of mean square one."""
    log = np.log(_LARGEST_SIZE)
    square = np.sinh(2.0 * log) / (2.0 * log)
    return float(np.exp(rng.uniform(-log, log)) / np.sqrt(square))


class _Constant:
    def __init__(self, rng: np.random.Generator, rms_m: float, *, view: int) -> None:
        self._shift = rms_m * rng.standard_normal((view + 1, N_JOINTS, 2))[view]

    def __call__(self, joints_cam: Float64Array) -> Float64Array:
        out = np.array(joints_cam)
        out[..., :2] += self._shift
        return out


class _Hidden:
    def __init__(self, rng: np.random.Generator, rms_m: float) -> None:
        self._pull = rms_m / _HIDDEN_RMS * rng.uniform(0.5, 1.5, N_JOINTS)

    def __call__(self, joints_cam: Float64Array) -> Float64Array:
        up = body_axes(joints_cam)[:, None, 2]
        sight = joints_cam / np.linalg.norm(joints_cam, axis=-1, keepdims=True)
        side = np.cross(up, sight)
        side = side / np.maximum(np.linalg.norm(side, axis=-1, keepdims=True), 1e-9)
        from_axis = joints_cam - joints_cam[:, [LAYOUT.index("pelvis")]]
        from_axis = from_axis - (from_axis * up).sum(-1, keepdims=True) * up
        behind, beside = (from_axis * sight).sum(-1), (from_axis * side).sum(-1)
        hidden = _step(behind, _BEHIND_M) * (1.0 - _step(np.abs(beside), _BESIDE_M))
        pull = self._pull * hidden * np.tanh(beside / _EDGE_M)
        return np.asarray(joints_cam + pull[..., None] * side)


class _Foreshortened:
    def __init__(self, rng: np.random.Generator, rms_m: float) -> None:
        self._shift = rms_m / _FORESHORTENED_RMS * rng.standard_normal((N_JOINTS, 3))

    def __call__(self, joints_cam: Float64Array) -> Float64Array:
        parents = np.array(PARENTS)
        parents[LAYOUT.index("pelvis")] = LAYOUT.index("spine")
        bone = joints_cam - joints_cam[:, parents]
        length = np.linalg.norm(bone, axis=-1) * np.linalg.norm(joints_cam, axis=-1)
        cosine = (bone * joints_cam).sum(-1) / np.maximum(length, 1e-9)
        in_body = cosine[..., None] ** 2 * self._shift
        return np.asarray(joints_cam + in_body @ body_axes(joints_cam))


def _step(value: Float64Array, limits: tuple[float, float]) -> Float64Array:
    """Smooth step (smoothstep) from 0 at the first limit to 1 at the second."""
    x = np.clip((value - limits[0]) / (limits[1] - limits[0]), 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))
