"""Which of two calibrations of the same cameras to keep."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.calibration import Calibration, Status


def should_replace(
    new: Calibration, old: Calibration | None, *, requested: bool, wrong: str = ""
) -> tuple[bool, str]:
    """Tell whether a new calibration takes the place of the one in force.

    It has to be ``OK`` and to have no fewer cameras. More cameras always win. With as many, one
    that a person asked for is taken, since he knows why, and so is one from after something has
    happened to a camera; any other has to be better supported: from no fewer inliers, or with
    smaller deviations.

    Parameters
    ----------
    new : Calibration
    old : Calibration or None
        The one in force.
    requested : bool
        A person asked for the new one.
    wrong : str
        Why the old one is known not to hold any more; empty if it is not. The new one must be from
        data of after that.

    Returns
    -------
    taken : bool
    reason : str
        For the log.
    """
    if new.status is not Status.OK:
        return False, f"{new.status.name}: {new.message}"
    if old is None:
        return True, "it is the first"
    n_new, n_old = len(new.cameras), len(old.cameras)
    if n_new != n_old:
        return n_new > n_old, f"it has {n_new} cameras, the one in force has {n_old}"
    if requested:
        return True, f"it was asked for and has as many cameras, {n_new}"
    if wrong:
        return True, f"the one before does not hold any more: {wrong}"
    return _better_supported(new, old)


def _better_supported(new: Calibration, old: Calibration) -> tuple[bool, str]:
    points = f"it rests on {new.n_inliers} image points, the one in force on {old.n_inliers}"
    if new.n_inliers >= old.n_inliers:
        return True, points
    stddev_new, stddev_old = rotation_stddev_rad(new), rotation_stddev_rad(old)
    deviations = f"{stddev_new:.2g} rad against {stddev_old:.2g} rad"
    if stddev_new < stddev_old:
        return True, f"its deviations are smaller: {deviations}"
    return False, f"{points}, and its deviations are not smaller: {deviations}"


def rotation_stddev_rad(calibration: Calibration) -> float:
    """Root mean square deviation of the rotations, the reference's left out; inf if unknown.

    Rotations compare whatever the unit of length is.
    """
    variances = [
        np.trace(camera.covariance[3:, 3:]) / 3.0
        for camera in calibration.cameras
        if camera.name != calibration.reference
    ]
    known = [v for v in variances if np.isfinite(v)]
    return float(np.sqrt(np.mean(known))) if known else float("inf")
