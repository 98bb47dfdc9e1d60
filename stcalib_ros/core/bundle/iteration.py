"""The result of one ISTBA iteration."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.lens_unknowns import corrections
from stcalib_ros.core.bundle.limits import (
    OTHER_DISTANCE,
    OTHER_POSITION,
    OTHER_ROTATION,
    OTHER_SCALE,
)
from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.residuals import errors_px, median_error
from stcalib_ros.core.bundle.state import BundleState
from stcalib_ros.core.geometry.lens import change_lens
from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.integration.association import Association
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.rig import Rig, _part


@dataclass(frozen=True, slots=True, eq=False)
class ClockSkews:
    """Skews of the clocks of the cameras (C,) against that of the reference.

    Attributes
    ----------
    skew : (C,) ndarray
        ``t_ref = t_cam + offset + skew (t_ref - middle_s)``; 0 where not observable.
    stddev : (C,) ndarray
        Predicted standard deviation; where not observable, that of an estimate.
    middle_s : float
        Time at which the offsets of the rig hold.
    """

    skew: Float64Array
    stddev: Float64Array
    middle_s: float


@dataclass(frozen=True, slots=True, eq=False)
class TimestampErrors:
    """Jitter of the timestamps of the cameras (C,), and what it leaves unknown of the clocks.

    Attributes
    ----------
    stddev_s : (C,) ndarray
        Standard deviation of the error of one timestamp.
    offset_variance, skew_variance : (C,) ndarray
        Variance of the mean and of the trend of the errors: no image separates these from offset
        and skew of the clock.
    """

    stddev_s: Float64Array
    offset_variance: Float64Array
    skew_variance: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class LineDelays:
    """Line delays of the rolling shutters of the cameras (C,), estimated.

    Attributes
    ----------
    line_s : (C,) ndarray
        Seconds per row; where not observable, the given one.
    stddev_s : (C,) ndarray
        Predicted standard deviation; where not observable, that of an estimate.
    first_row_s : (C,) ndarray
        What to add to the offsets of the rig for them to hold for row 0.
    """

    line_s: Float64Array
    stddev_s: Float64Array
    first_row_s: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class Iteration:
    """The result of one round of association, adjustment and outlier removal.

    Attributes
    ----------
    rig : Rig
        Poses and offsets after the adjustment.
    association : Association
        Association of tracks that the adjustment was made with.
    observations : Observations
    state : BundleState
        State of the adjustment; `state.inlier` are the inliers.
    median_px : float
        Median reprojection error of the inliers, px.
    coverage : float
        Number of keypoints of the recording per observation: more than 1 where these are thinned.
    explained_fraction : float
        Fraction of the keypoints of a camera, associated or not, that are inliers; the smallest
        of all cameras.
    clock_skews : ClockSkews or None
        None where the clocks are synchronised, and before they are estimated.
    timestamp_errors : TimestampErrors or None
        None where no jitter of the timestamps is observable.
    line_delays : LineDelays or None
        None where they were not estimated.
    lens_stddev : (5, C) ndarray or None
        Standard deviations of the corrections of the lenses; 0 of what was not estimated. None
        where all lenses are given, and before they are known.
    uncorrected : Iteration or None
        The round before the keypoints were corrected for their biases; None where they were not.
    """

    rig: Rig
    association: Association
    observations: Observations
    state: BundleState
    median_px: float
    coverage: float
    explained_fraction: float
    clock_skews: ClockSkews | None = None
    timestamp_errors: TimestampErrors | None = None
    line_delays: LineDelays | None = None
    lens_stddev: Float64Array | None = None
    uncorrected: Iteration | None = None

    def with_state(self, observations: Observations, state: BundleState) -> Iteration:
        """The same persons after one more adjustment of the same images."""
        before = replace(self.rig, offset_s=self.rig.offset_s - self.state.shift_s)
        errors = errors_px(observations, state)
        median = median_error(errors, state.inlier)
        return replace(
            self,
            rig=_rig_of(state, before),
            observations=observations,
            state=state,
            median_px=median,
        )

    def rms_px(self) -> float:
        """Root mean square reprojection error of the inliers, px; NaN if there is none.

        A point without parallax may come to lie behind a camera: it has no error.
        """
        errors = errors_px(self.observations, self.state)
        errors = errors[self.state.inlier & np.isfinite(errors)]
        return float(np.sqrt((errors**2).mean())) if len(errors) else float("nan")

    def fit(self, scale_px: float) -> float:
        """How much of all that was seen this round explains, beyond what it was free to fit.

        A robust count of image points, less one and a half for each joint position: three
        unknowns take up as much of two coordinates. Two views always find some point that
        suits them, so that a person split in two groups of cameras explains little.
        """
        errors = errors_px(self.observations, self.state)
        good = self.observations.observed & np.isfinite(errors)
        value = (1.0 / (1.0 + (errors[good] / scale_px) ** 2)).sum()
        n_points = self.state.triangulated().sum()
        return float((value - 1.5 * n_points) * self.coverage)

    def differing(self, other: Iteration, tolerance_s: float) -> IntArray:
        """Cameras that stand elsewhere, or whose clock is off by more, in the other solution.

        Counted against the camera that leaves fewest of them, among those that both have; all of
        them differ if the two have not two cameras in common.
        """
        common = np.intersect1d(self.rig.cameras, other.rig.cameras)
        fewest = self.rig.cameras if len(common) < 2 else common
        for anchor in common if len(common) > 1 else ():
            cameras = np.array([anchor, *(c for c in common if c != anchor)])
            mine, its = (_part(one.rig, cameras) for one in (self, other))
            elsewhere = cameras[_elsewhere(mine, its, tolerance_s)]
            fewest = min(fewest, elsewhere, key=len)
        return fewest

    def clock_difference_s(self, other: Iteration) -> float:
        """Largest difference of the offsets of cameras that both have, seconds."""
        common = np.intersect1d(self.rig.cameras, other.rig.cameras)
        if not len(common):
            return float("inf")
        mine, its = (_part(one.rig, common) for one in (self, other))
        return float(np.abs(mine.offset_s - its.offset_s).max())


def absorbed(last: Iteration) -> Iteration:
    """Return a round with its keypoints undistorted by the lenses that it found."""
    obs, state = last.observations, last.state
    if state.lenses is None:
        return last
    lenses = state.lenses.absorbing(corrections(state.cameras))
    x, focal = obs.x.copy(), obs.focal.copy()
    pairs = zip(state.lenses.intrinsics, lenses.intrinsics, strict=True)
    for c, (before, after) in enumerate(pairs):
        x[:, c], focal[:, c] = change_lens(obs.x[:, c].astype(np.float64), before, after)
    seen = obs.observed & np.isfinite(x).all(-1)
    x = np.where(seen[..., None], x, 0.0).astype(obs.x.dtype)
    focal = np.where(seen, focal, 1.0).astype(obs.focal.dtype)
    kept = {one: value for one, value in state.further.items() if one.row is None}
    return replace(
        last,
        observations=replace(obs, x=x, focal=focal, observed=seen, lenses=lenses),
        state=replace(state, further=kept, lenses=lenses).with_inliers(state.inlier & seen),
    )


def _rig_of(state: BundleState, rig: Rig) -> Rig:
    R_ref_cam = np.swapaxes(state.R_cam_ref, -1, -2)
    lenses = state.lenses
    if lenses is not None:
        lenses = lenses.absorbing(corrections(state.cameras))
    return replace(
        rig,
        R_ref_cam=R_ref_cam,
        t_ref_cam=0.0 - np.einsum("cij,cj->ci", R_ref_cam, state.t_cam_ref),
        offset_s=rig.offset_s + state.shift_s,
        lenses=() if lenses is None else lenses.intrinsics,
    )


def _elsewhere(one: Rig, other: Rig, tolerance_s: float) -> BoolArray:
    """Cameras (C,) that stand, look or run elsewhere in another rig of the same cameras.

    Compared at the scale that leaves fewest of them, since the solutions may take the people for
    larger or smaller.
    """
    turned = rotation_angle(np.swapaxes(one.R_ref_cam, -1, -2) @ other.R_ref_cam)
    shifted = np.abs(one.offset_s - other.offset_s)
    reach, its_reach = (np.linalg.norm(rig.t_ref_cam, axis=-1) for rig in (one, other))
    scales = reach[1:] / np.maximum(its_reach[1:], 1e-9)
    scales = np.clip(np.array([np.median(scales), *scales]), 1 / OTHER_SCALE, OTHER_SCALE)
    distance = np.linalg.norm(one.t_ref_cam - scales[:, None, None] * other.t_ref_cam, axis=-1)
    moved = distance > OTHER_POSITION + OTHER_DISTANCE * reach
    elsewhere = (turned > OTHER_ROTATION) | moved | (shifted > tolerance_s)
    return np.asarray(elsewhere[int(elsewhere.sum(-1).argmin())])
