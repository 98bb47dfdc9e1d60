"""Is this calibration to be trusted? What each camera rests on, and what is wrong with it.

The adjustment only sees image points. The monocular 3D poses are an independent witness:
their bones must point the way the rotations say, and people must be as far from every camera
as their size says. Other clock offsets are tried on the epipolar lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.bundle.covariance import (
    CENTRE_ROWS,
    OFFSET_ROW,
    ROTATION_ROWS,
    largest_stddev,
    rows_of,
)
from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.outliers import image_points
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.validation.cross_view import bone_rotations, depth_ratios, usual_distances
from stcalib_ros.core.validation.lookalikes import has_lookalike_alternative
from stcalib_ros.core.validation.offset_ambiguity import offset_peak_ratios

MIN_INLIERS = 400
MAX_ROTATION_STDDEV = 0.015
MAX_CENTRE_STDDEV = 0.10
MAX_OFFSET_STDDEV_FRAMES = 1.0
MAX_BONE_ROTATION = 0.3
DEPTH_RATIO = 1.6
MIN_INLIER_SHARE = 0.55
LONG_ENOUGH_S = 2.5
MIN_EXPLAINED_OF_SHORT = 0.7
MIN_EXPLAINED = 0.5
SURE_ROTATION_STDDEV = 0.005
SURE_BONE_ROTATION = 0.1
SURE_OFFSET_CONTRAST = 3.0
MIN_OFFSET_CONTRAST = 1.2
MANY_OUTLIERS = 0.2
MIN_CONTRAST_WITH_OUTLIERS = 1.1


@dataclass(frozen=True, slots=True, eq=False)
class CameraChecks:
    """What the pose of one camera rests on.

    Attributes
    ----------
    inliers : int
        Image points that fit.
    inlier_share : float
        Of the image points of associated persons.
    explained : float
        Inliers over all image points that it has, of whomever. Two cameras that share nobody
        still find a pose at which somebody's steps agree for a while.
    shared_s : float
        Time for which it sees somebody together with another camera, summed over persons. Of a
        second or two, some other stretch of steps fits as well sooner or later.
    rotation_stddev : float
        Largest standard deviation of its rotation about any axis, rad.
    centre_stddev : float
        The same of its centre, over its usual distance from the people.
    offset_stddev_frames : float
    bone_rotation : float
        Angle between its rotation and the one that the monocular poses ask for, rad; the
        smallest over the cameras it shares people with.
    depth_ratio : float
        Distance of people by triangulation over distance by their size, relative to the
        other cameras.
    offset_contrast : float
        How many times worse the best other offset, three frames or more away, fits.
    other_offset_s : float
        How far away that one is.
    doubled : bool
        It would fit at another place as well: everybody whom it sees moves like somebody else.
    contrast_with_outliers : float
        The contrast of its offset in all image points of associated persons, of the reference
        camera's against all others, where many do not fit; else infinite.
    """

    inliers: int
    inlier_share: float
    explained: float
    shared_s: float
    rotation_stddev: float
    centre_stddev: float
    offset_stddev_frames: float
    bone_rotation: float
    depth_ratio: float
    offset_contrast: float
    other_offset_s: float
    doubled: bool = False
    contrast_with_outliers: float = float("inf")

    def complaint(self) -> str | None:
        """The first thing that is wrong, with its number and what would help; None if nothing."""
        return self._unshared() or self._mixed_up() or self._uncertain()

    def _unshared(self) -> str | None:
        if self.inliers < MIN_INLIERS:
            return (
                f"only {self.inliers} of its image points fit, {MIN_INLIERS} are needed: "
                "have people walk where it and the others see them"
            )
        if self.inlier_share < MIN_INLIER_SHARE:
            return (
                f"only {100 * self.inlier_share:.0f} % of its image points fit: check its "
                "intrinsics, and that its key points belong to the image CameraInfo describes"
            )
        sure = (
            self.rotation_stddev < SURE_ROTATION_STDDEV
            and self.bone_rotation < SURE_BONE_ROTATION
            and self.offset_contrast > SURE_OFFSET_CONTRAST
        )
        if self.explained < MIN_EXPLAINED and not sure:
            return (
                f"only {100 * self.explained:.0f} % of all that it sees agrees with the others: "
                "it may show other people; let the same people walk where it and the others see "
                "them, and record longer"
            )
        if self.shared_s < LONG_ENOUGH_S and self.explained < MIN_EXPLAINED_OF_SHORT:
            return (
                f"it shares only {self.shared_s:.1f} s of somebody's motion with the others, and "
                f"only {100 * self.explained:.0f} % of all that it sees agrees with them: that may "
                "be chance; let people stay in view of two cameras for longer"
            )
        return None

    def _mixed_up(self) -> str | None:
        if self.doubled:
            return (
                "everybody whom it sees moves like somebody else at another place, and it fits "
                "there as well: let everybody move in his own way"
            )
        if not self.bone_rotation < MAX_BONE_ROTATION:
            return (
                f"the bones of its 3D poses disagree with its rotation by "
                f"{np.degrees(self.bone_rotation):.0f} degrees: persons may be mixed up; "
                "record a longer clip with people who move differently"
            )
        if not 1 / DEPTH_RATIO < self.depth_ratio < DEPTH_RATIO:
            return (
                f"people would be {self.depth_ratio:.1f} times as far from it as their size says: "
                "persons may be mixed up; record a longer clip with people who move differently"
            )
        return None

    def _uncertain(self) -> str | None:
        if not self.rotation_stddev < MAX_ROTATION_STDDEV:
            return (
                f"its rotation is uncertain by {np.degrees(self.rotation_stddev):.1f} degrees: "
                "it shares too little with the others; let people walk across more of its view"
            )
        if not self.centre_stddev < MAX_CENTRE_STDDEV:
            return (
                f"its position is uncertain by {100 * self.centre_stddev:.0f} % of its distance "
                "from the people: let them walk across more of its view"
            )
        if not self.offset_contrast > MIN_OFFSET_CONTRAST:
            return (
                f"its clock offset cannot be told: one that is {self.other_offset_s:.2f} s away "
                f"fits as well (error {self.offset_contrast:.2f} times as large, "
                f"{MIN_OFFSET_CONTRAST:.2f} needed); people have to move more, and not in the same "
                "rhythm all the time"
            )
        if not self.contrast_with_outliers > MIN_CONTRAST_WITH_OUTLIERS:
            return (
                f"only {100 * self.inlier_share:.0f} % of its image points fit, and with another "
                "clock offset all of them fit as well: people have to move more, and not in the "
                "same rhythm all the time"
            )
        if not self.offset_stddev_frames < MAX_OFFSET_STDDEV_FRAMES:
            return (
                f"its clock offset is uncertain by {self.offset_stddev_frames:.1f} frames: "
                "people have to move faster, or the clip has to be longer"
            )
        return None


def check_cameras(
    cameras: Sequence[LiftedCamera],
    skeleton: Skeleton,
    last: Iteration,
    covariance: Float64Array,
    *,
    offset_range_s: float,
) -> tuple[CameraChecks, ...]:
    """Evidence on every camera of the rig, the reference included.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    skeleton : Skeleton
    last : Iteration
    covariance : (7 C, 7 C) ndarray
        As `covariance.pose_covariance` gives it.
    offset_range_s : float
        Other offsets are tried within plus and minus this.
    """
    C, frame_s = len(last.rig.cameras), last.observations.step_s
    asked = not last.rig.synchronised
    max_shift = int(np.ceil(offset_range_s / frame_s))
    contrast, away_s = offset_peak_ratios(last, max_shift=max_shift)
    used, seen = last.state.used.sum((0, 2)), last.observations.seen.sum((0, 2))
    inlier_share = used / np.maximum(seen, 1)
    with_outliers = np.full(C, np.inf)
    if asked and inlier_share.min() < 1.0 - MANY_OUTLIERS:
        found_all, _ = offset_peak_ratios(last, max_shift=max_shift, with_outliers=True)
        with_outliers = np.where(inlier_share < 1.0 - MANY_OUTLIERS, found_all, np.inf)
    shared = last.state.used.any(2).sum(0)
    total = image_points([cameras[c] for c in last.rig.cameras])
    reach = usual_distances(last)
    turned = bone_rotations(cameras, skeleton, last)
    depth = depth_ratios(cameras, last)
    depth /= np.nanmedian(depth) if np.isfinite(depth).any() else 1.0
    doubled = has_lookalike_alternative(last)
    found = []
    for c in range(C):
        block = covariance[np.ix_(rows_of(c), rows_of(c))]
        found.append(
            CameraChecks(
                inliers=int(used[c]),
                inlier_share=float(inlier_share[c]),
                explained=float(used[c] / max(int(total[c]), 1)),
                shared_s=float(shared[c]) * frame_s,
                rotation_stddev=largest_stddev(block[ROTATION_ROWS, ROTATION_ROWS]),
                centre_stddev=largest_stddev(block[CENTRE_ROWS, CENTRE_ROWS]) / float(reach[c]),
                offset_stddev_frames=largest_stddev(block[OFFSET_ROW:, OFFSET_ROW:]) / frame_s,
                bone_rotation=float(np.nanmin(turned[c], initial=np.inf)),
                depth_ratio=float(depth[c]),
                offset_contrast=float(contrast[c]) if asked and c else float("inf"),
                other_offset_s=float(away_s[c]),
                doubled=bool(doubled[c]),
                contrast_with_outliers=float(with_outliers[c]),
            )
        )
    return tuple(found)
