"""Checks of each camera: what supports its pose and clock, and whether that is enough.

The adjustment only knows keypoints. Independent of it are the bodies: limbs keep their length, and
people are as far from every camera as their size says. Where there are monocular 3D poses, their
bones must point the way that the rotations say. Other time offsets are tried on the epipolar lines.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypedDict

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
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.validation.cross_view import bone_rotations, depth_ratios, usual_distances
from stcalib_ros.core.validation.inconsistencies import inconsistencies
from stcalib_ros.core.validation.limb_lengths import limb_variations
from stcalib_ros.core.validation.lookalikes import has_lookalike_alternative
from stcalib_ros.core.validation.offset_ambiguity import offset_peak_ratios
from stcalib_ros.core.validation.repeated_motion import repetition_ratios
from stcalib_ros.core.validation.thresholds import DEFAULT, CheckThresholds


@dataclass(frozen=True, slots=True, eq=False)
class CameraChecks:
    """What supports the pose and the clock of one camera.

    Attributes
    ----------
    inliers : int
        Number of keypoints that fit.
    inlier_fraction : float
        Inliers over the keypoints of associated persons.
    explained_fraction : float
        Inliers over all keypoints that it has, of whomever. Two cameras that share nobody still
        find a pose at which somebody's steps agree for a while.
    shared_s : float
        Time for which it observes somebody together with another camera, summed over persons. In
        a second or two, some other stretch of steps fits as well.
    rotation_stddev : float
        Largest standard deviation of its rotation about any axis, rad.
    position_stddev : float
        The same of its position, over its usual distance from the people.
    offset_stddev_frames : float
        Standard deviation of its time offset.
    bone_rotation : float
        Angle between its rotation and that of the bones of the monocular poses, rad; the smallest
        over the cameras that it shares people with. NaN where there are too few 3D poses to tell.
    depth_ratio : float
        Distance of people by triangulation over distance by their size, relative to the other
        cameras. NaN where no size is known.
    limb_variation : float
        By how much the lengths of people's limbs vary over time and between left and right, of the
        limbs that it observes: root mean square, relative. NaN where too few are observed.
    offset_peak_ratio : float
        Error at the best other time offset, three frames or more away, over the error at its own.
    alternative_offset_s : float
        Distance of that other time offset from its own.
    has_lookalikes : bool
        It would fit at another place as well: everybody whom it observes moves like somebody else.
    offset_peak_ratio_with_outliers : float
        `offset_peak_ratio` in all keypoints of associated persons, of the reference camera's
        against all others, where many are outliers; else infinite.
    repetition_ratio : float
        Error at another time offset, a repetition of the motion away, at the place that belongs to
        it, over the error at its own; infinite where no motion repeats itself at another place.
    period_s : float
        Distance of that time offset from its own.
    inconsistencies : tuple of Rejection
        What its own residuals say against its lens, its clock, or a pose that stays the same.
    remarks : tuple of Remark
        What they say that does little harm.
    """

    inliers: int
    inlier_fraction: float
    explained_fraction: float
    shared_s: float
    rotation_stddev: float
    position_stddev: float
    offset_stddev_frames: float
    bone_rotation: float
    depth_ratio: float
    limb_variation: float
    offset_peak_ratio: float
    alternative_offset_s: float
    has_lookalikes: bool = False
    offset_peak_ratio_with_outliers: float = float("inf")
    repetition_ratio: float = float("inf")
    period_s: float = 0.0
    inconsistencies: tuple[Rejection, ...] = ()
    remarks: tuple[Remark, ...] = ()


def rejection(
    checks: CameraChecks, thresholds: CheckThresholds = DEFAULT, *, camera: str = ""
) -> Rejection | None:
    """Return the first reason to reject a camera, with its number; None if there is none.

    Parameters
    ----------
    checks : CameraChecks
    thresholds : CheckThresholds
        Limits to decide by.
    camera : str
        Name of the camera.
    """
    for violations in (_inconsistent, _unsupported, _mixed_up, _uncertain):
        for found in violations(checks, thresholds):
            return replace(found, cameras=(camera,) if camera else ())
    return None


def _inconsistent(checks: CameraChecks, _: CheckThresholds) -> Iterator[Rejection]:
    """Yield what is wrong with the input of a camera: it explains all else."""
    yield from checks.inconsistencies


def _unsupported(checks: CameraChecks, limits: CheckThresholds) -> Iterator[Rejection]:
    """Yield what says that too little of what a camera observes agrees with the others."""
    if checks.inliers < limits.min_inliers:
        yield _violated(
            RejectionReason.TOO_FEW_INLIERS, checks.inliers, limits.min_inliers, "keypoints"
        )
    if checks.inlier_fraction < limits.min_inlier_fraction:
        yield _violated(
            RejectionReason.TOO_MANY_OUTLIERS, checks.inlier_fraction, limits.min_inlier_fraction
        )
    explained = checks.explained_fraction
    if explained < limits.min_explained_fraction and not _is_certain(checks, limits):
        yield _violated(
            RejectionReason.TOO_LITTLE_EXPLAINED, explained, limits.min_explained_fraction
        )
    short = checks.shared_s < limits.min_shared_s
    if short and explained < limits.min_explained_fraction_if_short:
        yield _violated(
            RejectionReason.TOO_LITTLE_SHARED_TIME,
            checks.shared_s,
            limits.min_shared_s,
            "s",
            explained_fraction=explained,
        )


def _is_certain(checks: CameraChecks, limits: CheckThresholds) -> bool:
    """Whether what agrees determines a camera so well that it does not matter how much does not.

    Limbs have to confirm it, and so have the bones of 3D poses where there are any.
    """
    return (
        checks.rotation_stddev < limits.certain_rotation_stddev
        and checks.limb_variation < limits.certain_limb_variation
        and not checks.bone_rotation >= limits.certain_bone_rotation
        and checks.offset_peak_ratio > limits.certain_offset_peak_ratio
    )


def _mixed_up(checks: CameraChecks, limits: CheckThresholds) -> Iterator[Rejection]:
    """Yield what says that persons are taken for each other; what is unknown (NaN) says nothing."""
    if checks.has_lookalikes:
        yield Rejection(RejectionReason.LOOKALIKES)
    if checks.bone_rotation >= limits.max_bone_rotation:
        yield _violated(
            RejectionReason.BONES_DISAGREE, checks.bone_rotation, limits.max_bone_rotation, "rad"
        )
    least, most = 1 / limits.max_depth_ratio, limits.max_depth_ratio
    if checks.depth_ratio <= least or checks.depth_ratio >= most:
        yield _violated(RejectionReason.DISTANCES_DISAGREE, checks.depth_ratio, most, least=least)
    if checks.limb_variation >= limits.max_limb_variation:
        yield _violated(
            RejectionReason.LIMBS_DISAGREE, checks.limb_variation, limits.max_limb_variation
        )
    if np.isnan(checks.bone_rotation) and np.isnan(checks.limb_variation):
        yield Rejection(RejectionReason.NOTHING_TO_VERIFY)


def _uncertain(checks: CameraChecks, limits: CheckThresholds) -> Iterator[Rejection]:
    """Yield what says that pose or clock are not determined."""
    if not checks.rotation_stddev < limits.max_rotation_stddev:
        yield _violated(
            RejectionReason.ROTATION_UNCERTAIN,
            checks.rotation_stddev,
            limits.max_rotation_stddev,
            "rad",
        )
    if not checks.position_stddev < limits.max_position_stddev:
        yield _violated(
            RejectionReason.POSITION_UNCERTAIN, checks.position_stddev, limits.max_position_stddev
        )
    if not checks.offset_peak_ratio > limits.min_offset_peak_ratio:
        yield _violated(
            RejectionReason.OFFSET_AMBIGUOUS,
            checks.offset_peak_ratio,
            limits.min_offset_peak_ratio,
            alternative_s=checks.alternative_offset_s,
        )
    if not checks.repetition_ratio > limits.min_repetition_ratio:
        yield _violated(
            RejectionReason.OFFSET_AMBIGUOUS,
            checks.repetition_ratio,
            limits.min_repetition_ratio,
            alternative_s=checks.period_s,
        )
    if not checks.offset_peak_ratio_with_outliers > limits.min_offset_peak_ratio_with_outliers:
        yield _violated(
            RejectionReason.OFFSET_AMBIGUOUS_WITH_OUTLIERS,
            checks.offset_peak_ratio_with_outliers,
            limits.min_offset_peak_ratio_with_outliers,
            inlier_fraction=checks.inlier_fraction,
        )
    if not checks.offset_stddev_frames < limits.max_offset_stddev_frames:
        yield _violated(
            RejectionReason.OFFSET_UNCERTAIN,
            checks.offset_stddev_frames,
            limits.max_offset_stddev_frames,
            "frames",
        )


def _violated(
    reason: RejectionReason, measured: float, limit: float, unit: str = "", **values: float
) -> Rejection:
    return Rejection(reason, (), float(measured), float(limit), unit, values=values)


def check_cameras(
    cameras: Sequence[LiftedCamera],
    skeleton: Skeleton,
    last: Iteration,
    covariance: Float64Array,
    *,
    offset_range_s: float,
) -> tuple[CameraChecks, ...]:
    """Check every camera of a rig, the reference included.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    skeleton : Skeleton
    last : Iteration
    covariance : (7 C, 7 C) ndarray
        Covariance of poses and time offsets, as `pose_covariance` returns it.
    offset_range_s : float
        Other time offsets are tried as long as they are within plus and minus this.
    """
    frame_s = last.observations.step_s
    inliers, observed = last.state.inlier.sum((0, 2)), last.observations.observed.sum((0, 2))
    inlier_fraction = inliers / np.maximum(observed, 1)
    offsets = _offset_checks(cameras, last, inlier_fraction, offset_range_s)
    shared_s = last.state.inlier.any(2).sum(0) * frame_s
    total = image_points([cameras[c] for c in last.rig.cameras])
    reach = usual_distances(last)
    bodies = _body_checks(cameras, skeleton, last)
    lookalikes = has_lookalike_alternative(last)
    in_motion = bool((offsets["offset_peak_ratio"] > DEFAULT.min_offset_peak_ratio).all())
    against = inconsistencies(cameras, skeleton, last, in_motion=in_motion)
    found = []
    for c in range(len(last.rig.cameras)):
        block = covariance[np.ix_(rows_of(c), rows_of(c))]
        found.append(
            CameraChecks(
                inliers=int(inliers[c]),
                inlier_fraction=float(inlier_fraction[c]),
                explained_fraction=float(inliers[c] / max(int(total[c]), 1)),
                shared_s=float(shared_s[c]),
                rotation_stddev=largest_stddev(block[ROTATION_ROWS, ROTATION_ROWS]),
                position_stddev=largest_stddev(block[CENTRE_ROWS, CENTRE_ROWS]) / float(reach[c]),
                offset_stddev_frames=largest_stddev(block[OFFSET_ROW:, OFFSET_ROW:]) / frame_s,
                has_lookalikes=bool(lookalikes[c]),
                inconsistencies=against[c].rejections,
                remarks=against[c].remarks,
                **{name: float(values[c]) for name, values in (bodies | offsets).items()},
            )
        )
    return tuple(found)


def _body_checks(
    cameras: Sequence[LiftedCamera], skeleton: Skeleton, last: Iteration
) -> dict[str, Float64Array]:
    """Fields of `CameraChecks` about bodies, of all cameras (C,)."""
    angle = bone_rotations(cameras, skeleton, last)
    least = np.where(np.isfinite(angle), angle, np.inf).min(1)
    depth = depth_ratios(cameras, last)
    usual = np.nanmedian(depth) if np.isfinite(depth).any() else 1.0
    return {
        "bone_rotation": np.where(np.isfinite(least), least, np.nan),
        "depth_ratio": depth / usual,
        "limb_variation": limb_variations(skeleton, last),
    }


class _Tried(TypedDict):
    """Other time offsets that are tried."""

    max_shift: int
    offset_range_s: float


def _offset_checks(
    cameras: Sequence[LiftedCamera],
    last: Iteration,
    inlier_fraction: Float64Array,
    offset_range_s: float,
) -> dict[str, Float64Array]:
    """Fields of `CameraChecks` about time offsets, of all cameras (C,).

    Where clocks are known, and of the reference, nothing is compared at their own places.
    """
    C, many = len(last.rig.cameras), 1.0 - DEFAULT.many_outliers
    furthest_s = offset_range_s + float(np.abs(last.rig.offset_s).max())
    tried: _Tried = {
        "max_shift": int(np.ceil(furthest_s / last.observations.step_s)),
        "offset_range_s": offset_range_s,
    }
    ratio, alternative_s = offset_peak_ratios(last, **tried)
    found = {
        "offset_peak_ratio": np.full(C, np.inf),
        "alternative_offset_s": alternative_s,
        "offset_peak_ratio_with_outliers": np.full(C, np.inf),
        "repetition_ratio": np.full(C, np.inf),
        "period_s": np.zeros(C),
    }
    if last.rig.synchronised:
        return found
    found["offset_peak_ratio"][1:] = ratio[1:]
    if inlier_fraction.min() < many:
        of_all, _ = offset_peak_ratios(last, **tried, with_outliers=True)
        among_all = np.where(inlier_fraction < many, of_all, np.inf)
        found["offset_peak_ratio_with_outliers"] = among_all
    repeated = repetition_ratios(cameras, last, **tried)
    found["repetition_ratio"], found["period_s"] = repeated
    return found
