"""Where a person is, from keypoints alone: by the usual size of an adult.

A limb of length L that appears as long as l on the plane z = 1 is at most L / l away, and as far
as that where it is seen from the side. Of all limbs of a person some are: trunk and shanks of those
who stand, forearms of those who sit.
"""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.lifting.limits import FACING_LIMBS
from stcalib_ros.core.model.arrays import Float64Array, FloatArray
from stcalib_ros.core.model.keypoint_layouts import TRUNK_JOINTS
from stcalib_ros.core.model.skeleton import Skeleton


def root_by_size(x: FloatArray, skeleton: Skeleton) -> Float64Array:
    """Return the middle of a body in the optical frame, as far away as its limbs appear.

    Parameters
    ----------
    x : (F, J, 2) ndarray
        Keypoints on the plane z = 1; NaN where not observed.
    skeleton : Skeleton

    Returns
    -------
    (F, 3) ndarray
        Metres, if the person is an adult of usual size; NaN where no limb is observed.
    """
    depth = depth_by_size(x, skeleton)
    names = skeleton.layout.joint_names
    trunk = [names.index(name) for name in TRUNK_JOINTS if name in names]
    middle = _mean(x[:, trunk])
    middle = np.where(np.isfinite(middle), middle, _mean(x))
    return np.concatenate([middle, np.ones((len(x), 1))], -1) * depth[:, None]


def depth_by_size(x: FloatArray, skeleton: Skeleton) -> Float64Array:
    """Return the depth (F,) of a body, metres, by the limbs that appear longest for their length.

    Parameters are those of `root_by_size`.
    """
    limbs = np.flatnonzero(np.isfinite(skeleton.adult_lengths))
    rows = skeleton.directions[limbs]
    vectors = np.einsum("dj,fjk->fdk", rows, np.nan_to_num(x))
    missing = (rows != 0).astype(float) @ (~np.isfinite(x[..., 0])).T.astype(float)
    inverse = np.linalg.norm(vectors, axis=-1) / skeleton.adult_lengths[limbs]
    known = missing.T == 0
    return 1.0 / _upper(np.where(known, inverse, np.nan), FACING_LIMBS)


def pose_size(joints: Float64Array, directions: Float64Array, adult_lengths: Float64Array) -> float:
    """Return the size of the bodies of 3D poses over that of an adult; NaN where no limb is known.

    Parameters
    ----------
    joints : (F, J, 3) ndarray
        Metres; NaN where unknown.
    directions : (D, J) ndarray
        Rows that make bones of joints, see `bone_vectors`.
    adult_lengths : (D,) ndarray
        Metres; NaN where not known.
    """
    limbs = np.flatnonzero(np.isfinite(adult_lengths))
    rows = directions[limbs]
    bones = np.einsum("dj,fjk->fdk", rows, np.nan_to_num(joints))
    complete = ~np.einsum("dj,fj->fd", rows != 0, ~np.isfinite(joints).all(-1)).astype(bool)
    lengths = np.where(complete, np.linalg.norm(bones, axis=-1), np.nan)
    measured = complete.any(0)
    total = float(np.nanmedian(lengths[:, measured], axis=0).sum()) if measured.any() else 0.0
    return total / float(adult_lengths[limbs][measured].sum()) if total > 0 else float("nan")


def _upper(values: Float64Array, fraction: float) -> Float64Array:
    """Return an upper quantile (F,) of the finite ones of values (F, D) above zero, else NaN."""
    ordered = np.sort(np.where(values > 0.0, values, np.nan), axis=-1)
    count = np.isfinite(ordered).sum(-1)
    at = np.ceil(fraction * np.maximum(count - 1, 0)).astype(int)
    return np.take_along_axis(ordered, at[:, None], -1)[:, 0] if ordered.size else values[:, 0]


def _mean(x: FloatArray) -> Float64Array:
    """Return the mean (F, 2) of the observed ones of some keypoints (F, n, 2), else NaN."""
    known = np.isfinite(x[..., 0])
    total = np.where(known[..., None], x, 0.0).sum(1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(total / known.sum(1)[:, None])
