"""Errors of a monocular 3D pose estimator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.synthetic.noise import smooth_noise
from stcalib_ros.core.synthetic.skeleton import N_JOINTS, PARENTS

_INHERITED = 0.8
"""Fraction of the error of its parent that a joint has as well: errors of lifters are correlated
along limbs. Chosen."""
_PARTS = ((0.25, None), (0.5, 0.5), (0.25, 0.06))
"""Fractions of the variance of joint errors with correlation times, s; None: constant. Chosen."""


@dataclass(frozen=True, slots=True)
class LifterErrors:
    """Errors of the 3D poses of one person from one camera.

    Attributes
    ----------
    mpjpe_m : float
        Mean distance of the root-relative joints from the truth that the joint errors alone make
        (before tilt, crop perspective and scale).
    depth_ratio : float
        Errors along the optical axis over those across.
    tilt_rad : float
        Root mean square angle of the slowly varying tilt.
    crop : float
        Fraction of the crop-perspective effect, 0..1.
    scale : float
        Estimated over true size.
    """

    mpjpe_m: float
    depth_ratio: float
    tilt_rad: float
    crop: float
    scale: float


def lift(
    rng: np.random.Generator, times: Float64Array, joints_cam: Float64Array, errors: LifterErrors
) -> Float64Array:
    """Monocular 3D pose of one person in one camera, relative to the root.

    Parameters
    ----------
    rng : Generator
    times : (T,) ndarray
        Seconds.
    joints_cam : (T, 17, 3) ndarray
        True joints in the optical frame, metres.
    errors : LifterErrors

    Returns
    -------
    (T, 17, 3) ndarray
    """
    relative = joints_cam - joints_cam[:, :1]
    wrong = relative + joint_errors(rng, times, errors.mpjpe_m, errors.depth_ratio)
    tilt = _tilt(rng, times, errors.tilt_rad)
    R = (tilt * crop_rotation(joints_cam[:, 0], errors.crop)).as_matrix()
    lifted: Float64Array = errors.scale * np.einsum("tab,tjb->tja", R, wrong)
    return lifted


def joint_errors(
    rng: np.random.Generator, times: Float64Array, mpjpe_m: float, depth_ratio: float
) -> Float64Array:
    """Return errors (T, 17, 3), metres, correlated over joints and frames; the root has none.

    A quarter of the variance is constant, half changes within a second, a quarter within a tenth.
    """
    shape = (N_JOINTS, 3)
    own = np.zeros((len(times), *shape))
    for fraction, tau_s in _PARTS:
        part = (
            rng.standard_normal(shape) if tau_s is None else smooth_noise(rng, times, shape, tau_s)
        )
        own = own + np.sqrt(fraction) * part
    error: Float64Array = own * np.array([1.0, 1.0, depth_ratio])
    error[:, 0] = 0.0
    for joint in range(1, N_JOINTS):
        error[:, joint] += _INHERITED * error[:, PARENTS[joint]]
    size = np.linalg.norm(error, axis=-1).mean() if len(times) else 1.0
    return error * (mpjpe_m / size)


def crop_rotation(root_cam: Float64Array, fraction: float) -> Rotation:
    """Return the rotation (T) from the bearing of the person to the optical axis, or a fraction.

    A lifter that works on a crop assumes that the camera looks straight at the person; it returns
    the true pose rotated by this.
    """
    bearing = root_cam / np.linalg.norm(root_cam, axis=-1, keepdims=True)
    axis = np.cross(bearing, [0.0, 0.0, 1.0])
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = np.arctan2(sine, bearing[:, 2:])
    return Rotation.from_rotvec(fraction * angle * axis / np.maximum(sine, 1e-12))


def _tilt(rng: np.random.Generator, times: Float64Array, rms_rad: float) -> Rotation:
    vector = np.sqrt(0.5) * (rng.standard_normal(3) + smooth_noise(rng, times, (3,), 1.0))
    return Rotation.from_rotvec(rms_rad / np.sqrt(3) * vector)
