"""Whether people's motion determined the lenses that were estimated, and whether they can be."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.lenses import FOCAL, focal_length
from stcalib_ros.core.bundle.motion_filter import depth_variance_ratio
from stcalib_ros.core.model.lens_knowledge import LensKnowledge, LensPrior
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark, RemarkCode

_MAX_FOCAL_STDDEV = 0.01
"""Ratio. Largest standard deviation of a focal length that people's motion determines. Measured on
keypoints of estimators, whose errors are no noise: focal lengths of "balance two" (0.003 to 0.009)
are off by 4 % at most, those of "demo" (0.015) by 9 %, of "balance one" (0.010 to 0.025) by 12 to
25 %; default scenes of benchmarks.accuracy.level have 0.002 to 0.005."""
_MAX_DEPTH_RATIO = 30.0
"""Ratio of the variances of joints along and across the rays. With more, cameras see people from
nearly one direction: a longer lens and people further away look the same, and noise decides.
Measured: 2 to 5 of three cameras and more, 3 to 18 of two that stand apart, 3 to 5 on real
recordings; 50 and more of cameras 60 cm apart, side by side or one over the other, which are off by
up to 37 % in their focal lengths, many times their standard deviations."""
_FAR = 3.0
"""Standard deviations of what was known before. A focal length that is further away was given
wrongly, or is estimated wrongly. Chosen: the usual ones."""
_VIEWS_DEG = (20.0, 145.0)
"""Degrees along the longer side of the image. Lenses that are looked for have 30 to 120, and the
adjustment goes a little beyond; what comes out far outside has run away. Derived: 125 degrees are
among the scenes of benchmarks.accuracy.level."""
_FISHEYE_DEG = 220.0
"""Degrees. The same of equidistant lenses at most. Derived: usual ones have up to 200."""


def estimated_lens_faults(
    cameras: Sequence[LiftedCamera], last: Iteration
) -> tuple[Rejection | Remark | None, ...]:
    """Return what is wrong with the lens of every camera of a rig; None where it was given.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    last : Iteration
    """
    members = [cameras[c] for c in last.rig.cameras]
    stddevs = last.lens_stddev
    focal_stddev = [0.0] * len(members) if stddevs is None else stddevs[FOCAL].tolist()
    depth_ratio = _depth_ratio(last)
    return tuple(
        next(_faults(camera, stddev, depth_ratio), None)
        for camera, stddev in zip(members, focal_stddev, strict=True)
    )


def _depth_ratio(last: Iteration) -> float:
    """Ratio of variances along and across the rays, where lenses are estimated."""
    if last.lens_stddev is None:
        return 1.0
    return depth_variance_ratio(last.observations, last.state)


def _faults(
    camera: LiftedCamera, stddev: float, depth_ratio: float
) -> Iterator[Rejection | Remark]:
    """Yield what is wrong with an estimated lens, the worst first."""
    lens, prior = camera.intrinsics, camera.lens_prior
    if prior is None and camera.lens_knowledge is LensKnowledge.REFINE:
        yield Remark(RemarkCode.LENS_HELD, (), {"limit_percent": 100.0 * _MAX_FOCAL_STDDEV})
    if lens is None or prior is None:
        return
    is_unknown = np.isinf(prior.focal_stddev)
    if is_unknown and depth_ratio > _MAX_DEPTH_RATIO:
        reason = RejectionReason.LENS_NEEDS_PARALLAX
        yield Rejection(reason, (), float(np.sqrt(depth_ratio)), float(np.sqrt(_MAX_DEPTH_RATIO)))
    if is_unknown and not stddev < _MAX_FOCAL_STDDEV:
        yield Rejection(RejectionReason.LENS_UNDETERMINED, (), stddev, _MAX_FOCAL_STDDEV)
    view_deg, (least, most) = _view_deg(lens)
    if not least < view_deg < most:
        limit = most if view_deg >= most else least
        values = {"focal_px": focal_length(lens)}
        yield Rejection(RejectionReason.LENS_IMPLAUSIBLE, (), view_deg, limit, "deg", values=values)
    if is_unknown:
        return
    off = _deviation(lens, prior)
    if abs(off) > _FAR:
        values = {"times": focal_length(lens) / prior.focal_px, "deviations": abs(off)}
        yield Remark(RemarkCode.LENS_FAR_FROM_GIVEN, (), values)


def _deviation(lens: Intrinsics, prior: LensPrior) -> float:
    """How many standard deviations a focal length is from what was known of it."""
    return float(np.log(focal_length(lens) / prior.focal_px)) / prior.focal_stddev


def _view_deg(lens: Intrinsics) -> tuple[float, tuple[float, float]]:
    """Field of view along the longer side, and between what it can be; degrees."""
    half = 0.5 * max(lens.width, lens.height) / focal_length(lens)
    if lens.model is LensModel.EQUIDISTANT:
        return float(np.degrees(2.0 * half)), (_VIEWS_DEG[0], _FISHEYE_DEG)
    return float(np.degrees(2.0 * np.arctan(half))), _VIEWS_DEG


def undetermined_lenses(cameras: Sequence[LiftedCamera], last: Iteration) -> list[int]:
    """Return cameras of which a lens was known before that people's motion does not determine.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    last : Iteration
    """
    if last.lens_stddev is None:
        return []
    lacks_parallax = _depth_ratio(last) > _MAX_DEPTH_RATIO
    pairs = zip(last.rig.cameras.tolist(), last.lens_stddev[FOCAL].tolist(), strict=True)
    return [
        c
        for c, stddev in pairs
        if (prior := cameras[c].lens_prior) is not None
        and np.isfinite(prior.focal_stddev)
        and (lacks_parallax or not stddev < _MAX_FOCAL_STDDEV)
    ]
