"""Whether people's motion determined the lenses that were estimated, and whether they can be."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.lenses import FOCAL, HELD, focal_length
from stcalib_ros.core.bundle.motion_filter import depth_variance_ratio
from stcalib_ros.core.model.lens_knowledge import LensPrior
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark, RemarkCode

_MAX_FOCAL_STDDEV = 0.03
"""Ratio. Largest standard deviation of a focal length by people's motion alone. Measured: 0.003 to
0.015 on scenes of benchmarks.accuracy.level with four cameras that are solved; 0.04 and more of two
cameras, which are off by up to 0.2, and where each camera sees somebody for a quarter of the time
only, which are off by up to 0.5."""
_MAX_DEPTH_RATIO = 30.0
"""Ratio of the variances of joints along and across the rays. With more, cameras see people from
nearly one direction: a longer lens and people further away look the same, and noise decides.
Measured: 2 to 5 of three cameras and more, 3 to 18 of two that stand apart; 50 and more of cameras
60 cm apart, side by side or one over the other, which are off by up to 37 % in their focal lengths,
many times their standard deviations."""
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
    if last.lens_stddev is None:
        return (None,) * len(members)
    focal_stddev = last.lens_stddev[FOCAL].tolist()
    depth_ratio = depth_variance_ratio(last.observations, last.state)
    return tuple(
        next(_faults(camera, stddev, depth_ratio), None)
        for camera, stddev in zip(members, focal_stddev, strict=True)
    )


def undetermined_guesses(cameras: Sequence[LiftedCamera], last: Iteration) -> tuple[int, ...]:
    """Return the cameras whose lenses were refined, though people's motion does not determine them.

    Those whose lenses are held are not among them.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    last : Iteration
    """
    if last.lens_stddev is None:
        return ()
    lacks_parallax = depth_variance_ratio(last.observations, last.state) > _MAX_DEPTH_RATIO
    return tuple(
        c
        for c, stddev in zip(last.rig.cameras.tolist(), last.lens_stddev[FOCAL], strict=True)
        if (prior := cameras[c].lens_prior) is not None
        if HELD < prior.focal_stddev < np.inf
        if lacks_parallax or _without_prior(float(stddev), prior) > _MAX_FOCAL_STDDEV
    )


def _without_prior(stddev: float, prior: LensPrior) -> float:
    """Standard deviation of a focal length by people's motion alone."""
    gained = stddev**-2 - prior.focal_stddev**-2
    return float(gained**-0.5) if gained > 0.0 else np.inf


def _faults(
    camera: LiftedCamera, stddev: float, depth_ratio: float
) -> Iterator[Rejection | Remark]:
    """Yield what is wrong with an estimated lens, the worst first."""
    lens, prior = camera.intrinsics, camera.lens_prior
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
    if prior.focal_stddev <= HELD:
        yield Remark(RemarkCode.LENS_HELD)
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
