"""A camera's clock against the reference clock."""

from __future__ import annotations

from typing import TypeVar

from stcalib_ros.core.model.arrays import Float64Array

Time = TypeVar("Time", float, Float64Array)


def clock_correction(offset: float, skew: float, since_epoch: Time) -> Time:
    """Return what to add to stamps of a camera to have the reference clock.

    ``t_ref = t_cam + offset + skew * (t_cam - epoch)``, the convention of everything that is
    published and written.

    Parameters
    ----------
    offset : float
        Time offset at the epoch.
    skew : float
        Clock skew, dimensionless.
    since_epoch : float or ndarray
        Stamps by the camera's clock minus the epoch, in the unit of the offset.

    Examples
    --------
    >>> round(clock_correction(-0.25, 2e-5, 86_400.0), 6)
    1.478
    """
    return offset + skew * since_epoch
