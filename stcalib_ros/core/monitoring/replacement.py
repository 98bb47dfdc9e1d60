"""Which of two calibrations of the same cameras to keep."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.calibration import Calibration, Status


def should_replace(
    new: Calibration, old: Calibration | None, *, requested: bool, wrong: str = ""
) -> tuple[bool, str]:
    """Decide whether a new calibration replaces the one in force.

    It has to be ``OK`` and to have no fewer cameras. More cameras always win. With as many, a
    requested one is accepted, and so is one made after a change of a camera; any other has to be
    better supported: by no fewer inliers, or with smaller standard deviations.

    Parameters
    ----------
    new : Calibration
    old : Calibration or None
        Calibration in force.
    requested : bool
        Whether a user requested the new one.
    wrong : str
        Why the old one is known to be wrong; empty if it is not. The new one must be made from
        data after that.

    Returns
    -------
    replaced : bool
    reason : str
        Reason for the log.
    """
    if new.status is not Status.OK:
        return False, f"{new.status.name}: {new.message}"
    if old is None:
        return True, "no calibration is in use"
    n_new, n_old = len(new.cameras), len(old.cameras)
    if n_new != n_old:
        return n_new > n_old, f"it has {n_new} cameras, the one in force has {n_old}"
    if requested:
        return True, f"it was requested and has as many cameras, {n_new}"
    if wrong:
        return True, f"the one in force is wrong: {wrong}"
    return _better_supported(new, old)


def _better_supported(new: Calibration, old: Calibration) -> tuple[bool, str]:
    points = f"it has {new.n_inliers} inliers, the one in force has {old.n_inliers}"
    if new.n_inliers >= old.n_inliers:
        return True, points
    stddev_new, stddev_old = rotation_stddev_rad(new), rotation_stddev_rad(old)
    both = f"{stddev_new:.2g} rad, the one in force {stddev_old:.2g} rad"
    if stddev_new < stddev_old:
        return True, f"its standard deviations are smaller: {both}"
    return False, f"{points}, and its standard deviations are not smaller: {both}"


def rotation_stddev_rad(calibration: Calibration) -> float:
    """Return the RMS standard deviation of the rotations without the reference; inf if unknown.

    Rotations can be compared whatever the unit of length is.
    """
    variances = [
        np.trace(camera.covariance[3:, 3:]) / 3.0
        for camera in calibration.cameras
        if camera.name != calibration.reference
    ]
    known = [v for v in variances if np.isfinite(v)]
    return float(np.sqrt(np.mean(known))) if known else float("inf")
