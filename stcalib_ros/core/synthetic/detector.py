"""Errors of a 2D keypoint detector."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.synthetic.skeleton import N_JOINTS, body_axes


class DetectorBias:
    """View-dependent bias of the keypoints of one person.

    In body axes, ``b_j(u) = A_j u + (u^T B_jk u)_k`` with the unit direction u from the body to the
    camera and traceless symmetric B: a polynomial of degree two without a constant part, which
    would only be another definition of the joint.

    Parameters
    ----------
    rng : Generator
    rms_m : float
        Root mean square over all directions of each component of a joint's displacement.
    """

    def __init__(self, rng: np.random.Generator, rms_m: float) -> None:
        linear = rng.standard_normal((N_JOINTS, 3, 3))
        square = rng.standard_normal((N_JOINTS, 3, 3, 3))
        square = square + square.swapaxes(-1, -2)
        square -= np.trace(square, axis1=-2, axis2=-1)[..., None, None] / 3 * np.eye(3)
        # Means over the sphere: of u_a u_b delta_ab / 3, of (u^T B u)^2 = 2 |B|^2 / 15.
        power = (linear**2).sum((1, 2)) / 3
        power_square = 2 * (square**2).sum((1, 2, 3)) / 15
        square *= np.sqrt(power / power_square)[:, None, None, None]
        norm = rms_m * np.sqrt(1.5 / power)
        self._linear = linear * norm[:, None, None]
        self._square = square * norm[:, None, None, None]

    def __call__(self, direction: Float64Array) -> Float64Array:
        """Displacements (T, 17, 3) in body axes, seen from unit directions (T, 3)."""
        pairs = direction[:, :, None] * direction[:, None, :]
        flat = pairs.reshape(-1, 9) @ self._square.reshape(-1, 9).T
        linear: Float64Array = np.einsum("jab,tb->tja", self._linear, direction)
        return np.asarray(linear + flat.reshape(-1, N_JOINTS, 3))


def displaced(joints_cam: Float64Array, bias: DetectorBias) -> Float64Array:
    """Return the points (T, 17, 3), optical frame, at which the detector places the joints."""
    R_body_cam = body_axes(joints_cam)
    root = joints_cam[:, 0]
    toward_camera = -root / np.linalg.norm(root, axis=-1, keepdims=True)
    offset = bias(np.einsum("tab,tb->ta", R_body_cam, toward_camera))
    return np.asarray(joints_cam + np.einsum("tba,tjb->tja", R_body_cam, offset))
