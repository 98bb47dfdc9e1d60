"""How people are turned towards the cameras, and smooth functions of that.

A detector puts a joint a few centimetres off, and as long as it sees the person from that side
it is the same few centimetres: no average over time removes them. They are modelled as a smooth
function of the direction from the body to the camera, in body axes, and of constant displacements
in the image: the same one in all cameras (an ankle found too low), and another one in each, as
light, background and clothes differ from view to view.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.keypoint_layouts import TRUNK_JOINTS, Layout

DEGREES = (1, 2, 3)
"""Degrees of the spherical harmonics of the viewing direction. Three: a bias that differs between
front, sides and back; higher ones are not observable in clips of seconds."""

DEGREE_OF = np.array([d for d in DEGREES for _ in range(2 * d + 1)])
"""Degree (B,) of every harmonic: 2 d + 1 harmonics of each degree d."""


def harmonics(u: Float64Array, degrees: Sequence[int] = DEGREES) -> Float64Array:
    """Real spherical harmonics (B, ...) of unit vectors (3, ...).

    Their mean square over the sphere is one; there is no constant one, which would only be
    another definition of the joint.
    """
    x, y, z = u
    by_degree = {
        1: [np.sqrt(3.0) * v for v in (x, y, z)],
        2: [
            *(np.sqrt(15.0) * v for v in (x * y, y * z, z * x)),
            np.sqrt(15.0) / 2.0 * (x**2 - y**2),
            np.sqrt(5.0) / 2.0 * (3.0 * z**2 - 1.0),
        ],
        3: [
            np.sqrt(7.0) / 2.0 * z * (5.0 * z**2 - 3.0),
            *(np.sqrt(42.0) / 4.0 * v * (5.0 * z**2 - 1.0) for v in (x, y)),
            np.sqrt(105.0) / 2.0 * z * (x**2 - y**2),
            np.sqrt(105.0) * x * y * z,
            np.sqrt(70.0) / 4.0 * x * (x**2 - 3.0 * y**2),
            np.sqrt(70.0) / 4.0 * y * (3.0 * x**2 - y**2),
        ],
    }
    return np.stack([f for d in degrees for f in by_degree[d]])


def trunk_of(layout: Layout) -> tuple[int, ...] | None:
    """Left and right hip, left and right shoulder; None in layouts that lack one."""
    if not set(TRUNK_JOINTS) <= set(layout.joint_names):
        return None
    return tuple(layout.index(name) for name in TRUNK_JOINTS)


def body_frames(
    X: Float64Array, trunk: tuple[int, ...], centres: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Axes of a body, and where the cameras stand in them.

    Parameters
    ----------
    X : (N, J, 3) ndarray
        Joints in the reference frame.
    trunk : tuple of int
        As `trunk_of` gives it.
    centres : (C, 3) ndarray
        Of the cameras.

    Returns
    -------
    R_ref_body : (3, 3, N) ndarray
        Columns forward, left, up.
    direction : (3, C, N) ndarray
        Unit vectors from the body to the cameras, in body axes.
    """
    left_hip, right_hip, left_shoulder, right_shoulder = (X[:, j].T for j in trunk)
    low, high = 0.5 * (left_hip + right_hip), 0.5 * (left_shoulder + right_shoulder)
    up = _unit(high - low)
    left = left_hip - right_hip + left_shoulder - right_shoulder
    left = _unit(left - (left * up).sum(0) * up)
    R = np.stack([np.cross(left, up, axis=0), left, up], 1)
    toward = _unit(centres.T[:, :, None] - 0.5 * (low + high)[:, None])
    return R, np.einsum("abn,acn->bcn", R, toward)


def _unit(v: Float64Array) -> Float64Array:
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=0), 1e-9))
