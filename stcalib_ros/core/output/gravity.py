"""Direction of gravity and ground plane, from people who stand and walk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.geometry.robust import RAYLEIGH_MEDIAN
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.core.output.limits import (
    LEAN_SCALE_RAD,
    MAX_UP_STDDEV_RAD,
    MIN_UP_STDDEV_RAD,
    OWN_LEAN_RAD,
)

HEAD = ("head_top", "head", "nose", "left_ear", "right_ear")
SHOULDERS = ("left_shoulder", "right_shoulder")
HIPS = ("left_hip", "right_hip", "pelvis")
ANKLES = ("left_ankle", "right_ankle")
_SOLES = ("heel", "toe", "foot")
_LEG = (("hip", "knee"), ("knee", "ankle"))

_HEADINGS = 8
"""Sectors of heading, count. Each counts once, so that leaning forward cancels although people look
one way most of the time. 45 degrees, about how constant the heading of a walking person is."""
_STEP = 0.04
"""Leg lengths. Standard deviation of the height of feet on the ground, 3 cm: soles, and noise of
ankles. Chosen on simulated walkers; not verified on real recordings."""
_SOLE_HEIGHT = {True: 0.03, False: 0.10}
"""Height of the joint of a standing foot in leg lengths: of heels and toes, and of ankles."""
_SOLE_STDDEV = 0.025
"""Leg lengths. Standard deviation of the height above, 2 cm: shoes and layouts."""
_WIDEST_STEPS = 8.0
"""Multiple of `_STEP` at which the robust fit of the floor starts (graduated non-convexity): a foot
may be lifted or on a stair by as much at first."""
_ITERATIONS = 20
"""Iterations of both robust fits, a fixed number."""
_MIN_HORIZONTAL = 0.2
"""Sine of the angle between the optical axis of the reference camera and the vertical. Below it
the camera looks down (or up), and its image's vertical gives the heading instead. Derived: the
heading is uncertain by at most five times the tilt."""
_MIN_NORM = 1e-9
"""Length of a mean direction or of a heading; keeps opposite directions from dividing by zero."""
_LOW_PERCENTILE = 20
"""Percentile of the lowest heights of feet that the fit of the floor starts from: below most feet
on steps and beams."""


@dataclass(frozen=True, slots=True, eq=False)
class GravityFrame:
    """A frame with z up and the floor at z = 0.

    x points where the reference camera looks, along the floor; the origin is below it. Where it
    looks straight down or up, x points where the top, or the bottom, of its image does.

    Attributes
    ----------
    R_world_ref : (3, 3) ndarray
    height : float
        Height of the reference camera in the unit of the people:
        ``x_world = R_world_ref @ x_ref + (0, 0, height)``.
    covariance : (3, 3) ndarray
        Covariance of the rotation about world x and y (rad) and of the height.
    """

    R_world_ref: Float64Array
    height: float
    covariance: Float64Array


def find_upright(
    layout: Layout, people: Sequence[Float64Array], *, block: int
) -> tuple[GravityFrame | None, str]:
    """Estimate the direction of gravity and the ground plane of a reconstruction.

    The direction from feet to head is that of gravity to a few degrees: leaning forward cancels if
    people look in all directions. A plane through the lowest positions of their feet refines it as
    far as people have walked.

    Parameters
    ----------
    layout : Layout
    people : sequence of (K, J, 3) ndarray
        Joints in the frame of the reference camera, uniform in time; NaN where unknown.
    block : int
        Number of samples of about a second, in which everybody puts a foot down.

    Returns
    -------
    upright : GravityFrame or None
    complaint : str
        Why there is no frame; else empty.
    """
    leg = _leg_length(layout, people)
    feet, is_sole = _feet(layout, people, block)
    found = body_up(layout, people, block=block)
    if found is None or not leg > 0.0 or not len(feet):
        return None, "nobody is observed from feet to head"
    up, stddev = found
    if stddev > MAX_UP_STDDEV_RAD:
        return None, f"people are not upright, up is uncertain by {np.degrees(stddev):.0f} degrees"
    R_level = _level(up)
    (a, b, c), covariance = _floor(feet @ R_level.T, stddev, _STEP * leg)
    normal = np.array([-a, -b, 1.0]) / np.sqrt(a * a + b * b + 1.0)
    R = _facing(_level(normal @ R_level))
    # Rotations about x and y of the level frame are b and -a; the same axes after turning.
    to_world = R[:2] @ R_level.T
    J = np.zeros((3, 3))
    J[:2, 0], J[:2, 1], J[2, 2] = -to_world[:, 1], to_world[:, 0], -1.0
    covariance = J @ covariance @ J.T
    covariance[2, 2] += (_SOLE_STDDEV * leg) ** 2
    return GravityFrame(R, float(_SOLE_HEIGHT[is_sole] * leg - c * normal[2]), covariance), ""


def body_up(
    layout: Layout, people: Sequence[Float64Array], *, block: int
) -> tuple[Float64Array, float] | None:
    """Return the direction from feet to head, and its standard deviation about each axis, rad.

    Every heading counts once, whoever has it and for how long. None if nobody is observed from feet
    to head. Parameters are those of `find_upright`.
    """
    parts = [joints[i : i + block] for joints in people for i in range(0, len(joints), block)]
    leans = [lean for part in parts if (lean := _lean(layout, part)) is not None]
    if not leans:
        return None
    ups = np.array([lean for lean, _ in leans])
    x, y, _ = _level(_mean_direction(ups)[0])
    heading = np.array([np.arctan2(left @ y, left @ x) for _, left in leans])
    sector = np.floor(heading / (2 * np.pi) * _HEADINGS)
    cells = [_mean_direction(ups[sector == k])[0] for k in np.unique(sector)]
    up, spread = _mean_direction(np.array(cells))
    own = OWN_LEAN_RAD / np.sqrt(len(cells))
    return up, float(np.sqrt(spread**2 + own**2 + MIN_UP_STDDEV_RAD**2))


def leg_length(layout: Layout, joints: Float64Array) -> float:
    """Return the length of thigh and shank of one person (K, J, 3), mean of both legs, or NaN."""
    legs = []
    for side in ("left", "right"):
        bones = [[f"{side}_{end}" for end in bone] for bone in _LEG]
        if not all(n in layout.joint_names for bone in bones for n in bone):
            continue
        ends = [[joints[:, layout.index(n)] for n in bone] for bone in bones]
        lengths = [np.linalg.norm(b - a, axis=-1) for a, b in ends]
        known = [length[np.isfinite(length)] for length in lengths]
        if all(len(length) for length in known):
            legs.append(sum(float(np.median(length)) for length in known))
    return float(np.mean(legs)) if legs else float("nan")


def _leg_length(layout: Layout, people: Sequence[Float64Array]) -> float:
    known = [leg for joints in people if np.isfinite(leg := leg_length(layout, joints))]
    return float(np.median(known)) if known else 0.0


def _lean(layout: Layout, joints: Float64Array) -> tuple[Float64Array, Float64Array] | None:
    """Return the mean directions of joints (K, J, 3) from feet to head and from right to left."""
    top, bottom = _middle(layout, joints, HEAD, SHOULDERS), _middle(layout, joints, ANKLES, HIPS)
    lines = [
        joints[:, layout.index(left)] - joints[:, layout.index(right)]
        for left, right in (SHOULDERS, HIPS[:2])
        if {left, right} <= set(layout.joint_names)
    ]
    if top is None or bottom is None or not lines:
        return None
    up, left = top - bottom, np.sum(lines, axis=0)
    known = np.isfinite(up + left).all(-1)
    if not known.any():
        return None
    mean = [
        (v / np.linalg.norm(v, axis=-1, keepdims=True)).mean(0) for v in (up[known], left[known])
    ]
    return mean[0] / max(float(np.linalg.norm(mean[0])), _MIN_NORM), mean[1]


def _middle(layout: Layout, joints: Float64Array, *choices: Sequence[str]) -> Float64Array | None:
    """Return the mean (K, 3) of the joints of the first choice that the layout has."""
    for names in choices:
        if index := [layout.index(n) for n in names if n in layout.joint_names]:
            return np.asarray(joints[:, index].mean(1))
    return None


def _mean_direction(directions: Float64Array) -> tuple[Float64Array, float]:
    """Return the robust mean of unit vectors (N, 3), and its stddev about each axis, rad."""
    mean = directions.mean(0)
    for _ in range(_ITERATIONS):
        mean = mean / max(float(np.linalg.norm(mean)), _MIN_NORM)
        angle = np.arccos(np.clip(directions @ mean, -1.0, 1.0))
        weight = 1.0 / (1.0 + (angle / LEAN_SCALE_RAD) ** 2)
        mean = weight @ directions
    mean = mean / max(float(np.linalg.norm(mean)), _MIN_NORM)
    return mean, float(np.median(angle) / RAYLEIGH_MEDIAN / np.sqrt(len(angle)))


def _feet(layout: Layout, people: Sequence[Float64Array], block: int) -> tuple[Float64Array, bool]:
    """Return the paths (B, M, 3) of all feet in blocks, and whether they are heels and toes."""
    soles = [n for n in layout.joint_names if any(part in n for part in _SOLES)]
    index = [layout.index(n) for n in soles or ANKLES if n in layout.joint_names]
    blocks = [
        joints[k * block : (k + 1) * block, index].reshape(block * len(index), 3)
        for joints in people
        for k in range(len(joints) // block)
    ]
    feet = np.array(blocks).reshape(len(blocks), block * len(index), 3)
    return feet[np.isfinite(feet).all(-1).any(-1)], bool(soles)


def _level(up: Float64Array) -> Float64Array:
    """Return a rotation that takes a unit vector to z."""
    x = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(up, x), up])


def heading_axis(R_world_ref: Float64Array) -> Float64Array:
    """Axis (3,) of the reference camera whose horizontal direction is x of the world.

    The optical axis; the vertical of the image where that is almost vertical itself. Both are the
    same direction for a camera without roll that is tilted down or up.
    """
    up_ref = R_world_ref[2]
    if np.hypot(up_ref[0], up_ref[1]) >= _MIN_HORIZONTAL:
        return np.array([0.0, 0.0, 1.0])
    return np.array([0.0, np.copysign(1.0, up_ref[2]), 0.0])


def _facing(R: Float64Array) -> Float64Array:
    """Rotate about z so that the reference camera heads along x."""
    x, y, _ = R @ heading_axis(R)
    cosine, sine = np.array([x, y]) / np.hypot(x, y)
    return np.asarray(np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]]) @ R)


def _floor(
    feet: Float64Array, tilt_stddev: float, step: float
) -> tuple[Float64Array, Float64Array]:
    """Fit the plane ``z = a x + b y + c`` of the lowest feet (B, M, 3); return its covariance, too.

    The lowest position of every block counts. Feet on steps and beams, and of people who lie, are
    above the floor and count less; a and b have a Gaussian prior by the direction of the bodies.
    """
    prior = np.diag([tilt_stddev**-2, tilt_stddev**-2, 0.0])
    plane = np.array([0.0, 0.0, np.nanpercentile(np.nanmin(feet[..., 2], axis=1), _LOW_PERCENTILE)])
    for scale in step * np.geomspace(_WIDEST_STEPS, 1.0, _ITERATIONS):
        above = feet[..., 2] - feet[..., :2] @ plane[:2] - plane[2]
        low = feet[np.arange(len(feet)), np.nanargmin(above, axis=1)]
        residual = np.nanmin(above, axis=1)
        A = np.concatenate([low[:, :2], np.ones((len(low), 1))], -1)
        weight = 1.0 / (1.0 + (residual / scale) ** 2) ** 2
        H = A.T @ (weight[:, None] * A) / step**2 + prior
        plane = np.linalg.solve(H, A.T @ (weight * low[:, 2]) / step**2)
    return plane, np.linalg.inv(H)
