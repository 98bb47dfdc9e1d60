"""Residuals of a camera by the angle from its optical axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.geometry.lens import bearings, project_plane
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.report.fits import KeypointFit

_WIDTHS_DEG = (1.0, 2.0, 3.0, 5.0, 10.0, 15.0)
"""Degrees. Widths of a bin, of which the first is taken that needs few enough bins. Chosen."""
_MOST_BINS = 8
"""Count. Most bins: as many numbers as fit side by side below a chart on a phone."""
_LEAST = 100
"""Count. Keypoints of a bin that is shown. Those of one person have errors in common: with lenses
that are right, medians of examples/film are off by 0.8 px in a bin of 50, by 0.5 px in one of 200;
a k1 that is wrong by 0.12 makes 1.0 px of it."""
_QUARTILES = (25.0, 50.0, 75.0)
"""Percent. The middle half of the values, and their median. By definition."""


@dataclass(frozen=True, slots=True, eq=False)
class ErrorsByAngle:
    """Errors of the keypoints that fit in B ranges of the angle from the optical axis.

    Attributes
    ----------
    name : str
        The camera.
    angle_deg : (B,) ndarray
        Middle of each range.
    width_deg : float
        Of every range.
    counts : (B,) ndarray of int
        Keypoints in it.
    error_px : (B, 3) ndarray
        Quartiles of the distances of keypoints from reprojected joints.
    outward_px : (B, 3) ndarray
        Quartiles of how much further from the axis the reprojected joint is than the keypoint.
    """

    name: str
    angle_deg: Float64Array
    width_deg: float
    counts: IntArray
    error_px: Float64Array
    outward_px: Float64Array


def errors_by_angle(fit: KeypointFit, lens: Intrinsics) -> ErrorsByAngle:
    """Return the residuals of a camera by the angle from its optical axis.

    With a focal length that is too large by a fraction, and everything else right, joints are
    projected too far outwards by that fraction of the distance from the principal point; an
    adjustment compensates most of that by the pose. It cannot compensate a wrong distortion: the
    median of `outward_px` then changes its sign between the middle and the edge of the image.

    Parameters
    ----------
    fit : KeypointFit
    lens : Intrinsics
        By which the joints were projected.
    """
    x, focal = bearings(fit.pixels, lens)
    reprojected = project_plane(x + fit.residuals / focal[:, None], lens)
    residual = reprojected - fit.pixels
    radius = fit.pixels - project_plane(np.zeros(2), lens)
    with np.errstate(invalid="ignore"):
        outward = (residual * radius).sum(-1) / np.linalg.norm(radius, axis=-1)
    angle = np.degrees(np.arctan(np.linalg.norm(x, axis=-1)))
    used = fit.fits & np.isfinite(outward) & np.isfinite(angle)
    error, outward, angle = np.linalg.norm(residual, axis=-1)[used], outward[used], angle[used]
    width = _width_deg(float(angle.max(initial=0.0)))
    number = np.floor(angle / width).astype(np.int64)
    counts = np.bincount(number)
    shown = np.flatnonzero(counts >= _LEAST)
    return ErrorsByAngle(
        name=fit.name,
        angle_deg=np.asarray(width * (shown + 0.5), np.float64),
        width_deg=width,
        counts=counts[shown].astype(np.int64),
        error_px=_quartiles(error, number, shown),
        outward_px=_quartiles(outward, number, shown),
    )


def _width_deg(largest_deg: float) -> float:
    enough = (width for width in _WIDTHS_DEG if width * _MOST_BINS > largest_deg)
    return next(enough, _WIDTHS_DEG[-1])


def _quartiles(values: Float64Array, number: IntArray, shown: IntArray) -> Float64Array:
    """Quartiles (B, 3) of the values in the bins that are shown."""
    rows = [np.percentile(values[number == k], _QUARTILES) for k in shown]
    return np.array(rows).reshape(-1, len(_QUARTILES))
