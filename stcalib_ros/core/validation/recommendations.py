"""The least constrained camera of a calibration, and what would constrain it better."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.rejection import Remark, RemarkCode
from stcalib_ros.core.refinement.limits import MAX_SKEW_STDDEV
from stcalib_ros.core.validation.camera_checks import CameraChecks
from stcalib_ros.core.validation.motion_ambiguity import is_collinear
from stcalib_ros.core.validation.thresholds import DEFAULT, LITTLE_SHARED_MOTION


def recommend(
    names: Sequence[str], checks: Sequence[CameraChecks], last: Iteration
) -> tuple[Remark, ...]:
    """Name the least constrained camera with its standard deviations, and what would help it most.

    Parameters
    ----------
    names : sequence of str
        Names of the cameras of the rig, the reference first.
    checks : sequence of CameraChecks
        Checks of the same cameras.
    last : Iteration
    """
    weak = max(range(1, len(checks)), key=lambda i: max(_levels(checks[i])))
    one = checks[weak]
    values = {
        "rotation_stddev_deg": float(np.degrees(one.rotation_stddev)),
        "position_stddev_percent": 100 * one.position_stddev,
    }
    if not last.rig.synchronised:
        offset_stddev_s = one.offset_stddev_frames * last.observations.step_s
        values["offset_stddev_ms"] = 1e3 * offset_stddev_s
    least = Remark(RemarkCode.LEAST_CONSTRAINED_CAMERA, (names[weak],), values)
    return least, _advice(names, checks, last, weak)


def _levels(one: CameraChecks) -> tuple[float, float, float]:
    """Standard deviations of rotation, position and clock over their limits."""
    return (
        one.rotation_stddev / DEFAULT.max_rotation_stddev,
        one.position_stddev / DEFAULT.max_position_stddev,
        one.offset_stddev_frames / DEFAULT.max_offset_stddev_frames,
    )


def _advice(
    names: Sequence[str], checks: Sequence[CameraChecks], last: Iteration, weak: int
) -> Remark:
    """Return what would help a camera most."""
    own = checks[weak].shared_s
    usual = float(np.median([one.shared_s for i, one in enumerate(checks) if i != weak]))
    if own < LITTLE_SHARED_MOTION * usual:
        common = shared_s(last)[weak]
        partners = [i for i in range(len(names)) if i != weak and common[i] > 0]
        partner = min(partners, key=lambda i: common[i])
        return Remark(
            RemarkCode.SHARE_MORE_VIEW,
            (names[weak], names[partner]),
            {"shared_s": own, "usual_s": usual, "common_s": float(common[partner])},
        )
    *place, clock = _levels(checks[weak])
    if clock > max(place):
        return Remark(RemarkCode.MOVE_FASTER, (names[weak],))
    if is_collinear(last):
        return Remark(RemarkCode.LEAVE_THE_LINE)
    return Remark(RemarkCode.RECORD_LONGER)


def shared_s(last: Iteration) -> Float64Array:
    """Time (C, C) for which two cameras see somebody together, summed over persons, seconds."""
    observed = last.state.inlier.any(2).astype(float)
    return np.asarray(observed.T @ observed * last.observations.step_s)


def unobservable_clock_skews(last: Iteration) -> tuple[Remark, ...]:
    """Return why clock skews are not estimated; empty where they are, or clocks are known.

    The standard deviation of a slope falls with the length to the power of one and a half.
    """
    if last.clock_skews is None:
        return ()
    stddev = last.clock_skews.stddev[1:][last.clock_skews.skew[1:] == 0.0]
    if not len(stddev):
        return ()
    obs = last.observations
    length_s = float(np.ptp(obs.time_bin)) * obs.step_s
    values, worst = {"length_s": length_s}, float(stddev.max())
    if np.isfinite(worst):
        values |= {
            "stddev_ppm": 1e6 * worst,
            "limit_ppm": 1e6 * MAX_SKEW_STDDEV,
            "enough_s": length_s * (worst / MAX_SKEW_STDDEV) ** (2.0 / 3.0),
        }
    return (Remark(RemarkCode.CLOCK_SKEW_NOT_OBSERVABLE, values=values),)


def without_poses(names: Sequence[str], checks: Sequence[CameraChecks]) -> tuple[Remark, ...]:
    """Return which cameras have no 3D poses to verify them by; empty where all have.

    Parameters
    ----------
    names : sequence of str
        Names of the cameras of the rig.
    checks : sequence of CameraChecks
        Checks of the same cameras.
    """
    without = [
        (name, one.limb_variation)
        for name, one in zip(names, checks, strict=True)
        if np.isnan(one.bone_rotation)
    ]
    if not without:
        return ()
    values = {"limb_variation_percent": 100.0 * max(variation for _, variation in without)}
    cameras = tuple(name for name, _ in without)
    return (Remark(RemarkCode.VERIFIED_BY_LIMBS_ALONE, cameras, values),)


def of_cameras(names: Sequence[str], checks: Sequence[CameraChecks]) -> tuple[Remark, ...]:
    """Return the remarks of the checks, each with the name of its camera.

    Parameters
    ----------
    names : sequence of str
        Names of the cameras of the rig.
    checks : sequence of CameraChecks
        Checks of the same cameras.
    """
    pairs = zip(names, checks, strict=True)
    return tuple(replace(one, cameras=(name,)) for name, each in pairs for one in each.remarks)
