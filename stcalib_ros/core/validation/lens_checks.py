"""Whether the keypoints of a camera are those of the lens that its CameraInfo describes.

Each camera is fitted once more, with its lens free, to the people that the others triangulate. One
whose lens comes out far from the one given bends the poses of all others a little: it is corrected,
everything adjusted again, and only then said who is wrong, and by how much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.levenberg_marquardt import adjust
from stcalib_ros.core.bundle.limits import TOLERANCE
from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.state import BundleState
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.core.model.rejection import Rejection, RejectionReason
from stcalib_ros.core.reconstruction.free_lens import (
    LENS,
    LensFit,
    Sighting,
    as_given,
    fit_lens,
    sighting,
    start_from_projection,
)

_LIMITS = np.array([0.05, 0.03, 0.05, 0.05, 0.04])
"""Largest deviations of the focal length and of the square root of fx / fy (logarithms), of the
principal point (plane z = 1), and by radial distortion at the edge of what was seen (ratio).
Measured with keypoints as they are given, without three standard deviations, as a multiple of the
limits: scenes of benchmarks.accuracy.level have 0.73 at most (keypoint bias that differs between
cameras; 0.33 else), those of real recordings 0.72; with a focal length that is 15 % off, an image
turned by half whose lens is 12 % off the middle, and a lens of 110 degrees without its distortion,
three recordings each of benchmarks.field, 1.5 to 2.9."""
_LEAST_CORRECTED = 0.4
"""Multiple of the limits that has to be left where keypoints were corrected for biases, which takes
away what bias does, and a part of what another lens does. Measured like `_LIMITS`: 0.18 at most and
0.76 at least."""
_DEVIATIONS = 3.0
"""Standard deviations by which a limit has to be exceeded. Chosen: besides the limit itself, which
is as large again."""
_MAX_STDDEV = 0.04
"""Largest standard deviation, in the units of the limits, of what says anything. Measured: people
who sit determine focal lengths to 0.06 and worse, and are off by that many times; scenes of people
who walk to 0.01, and to 0.024 with keypoints of a third of the image."""
_SURE = 0.5
"""Fraction of a limit. A fit that stays within is not tried from another start. Chosen."""
_EDGE = 0.95
"""Quantile of the distances from the axis that distortion is measured at. Chosen."""
_MAX_POINTS = 4000
"""Joints, count. Of more a regular part is adjusted again. Cost alone."""
_ROUNDS = 2
"""Corrections of the worst camera. Measured: of a camera of four with keypoints of a third of the
image, the first brings the scale from 0.52 to 0.41, further ones nowhere."""
_STEPS = 12
"""Steps of each adjustment in between. Numerical."""
_ACCOMPLICE = 0.3
"""Ratio. A camera whose lens is further off than this fraction of the worst one's is named as well.
Measured: of one bad camera of three or four the others have 0.05, and 0.2 while it is not quite
corrected; where all have keypoints of three quarters, the least has 0.5 of the worst."""
_TURNED = 0.9
"""Cosine. A principal point that is off in the direction in which its exchanged coordinates are is
that of an image turned by a quarter. Chosen: 25 degrees."""


@dataclass(frozen=True, slots=True, eq=False)
class _Deviation:
    """How far the lens of a camera is from the one given.

    Attributes
    ----------
    fit : LensFit
    values, excess : (5,) ndarray
        Deviations in the units of `_LIMITS`, and their certain part over the limits.
    """

    fit: LensFit
    values: Float64Array
    excess: Float64Array


def lens_faults(cameras: Sequence[LiftedCamera], last: Iteration) -> tuple[Rejection | None, ...]:
    """Return which cameras of a rig have another lens than the one given; None for the others.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    last : Iteration
    """
    given = last.uncorrected or last
    obs, state = given.observations, given.state
    C = len(state.t_cam_ref)
    starts = [as_given(R, t) for R, t in zip(state.R_cam_ref, state.t_cam_ref, strict=True)]
    found = [_deviation(obs, state, c, starts[c]) for c in range(C)]
    worst = max(range(C), key=lambda c: _most(found[c]))
    if _most(found[worst]) < 1.0 or not _is_seen_corrected(last, worst):
        return (None,) * C
    if not _is_distorted(found[worst]):
        found = _without_the_worst(obs, state, found, worst)
    least = max(1.0, _ACCOMPLICE * _most(found[worst]))
    intrinsics = [cameras[c].intrinsics for c in last.rig.cameras]
    return tuple(
        None if one is None or _most(one) < least else _rejection(one, lens)
        for one, lens in zip(found, intrinsics, strict=True)
    )


def _most(one: _Deviation | None) -> float:
    return 0.0 if one is None else float(one.excess.max())


def _is_seen_corrected(last: Iteration, c: int) -> bool:
    """Whether the lens of a camera is off with corrected keypoints, too."""
    if last.uncorrected is None:
        return True
    state = last.state
    start = as_given(state.R_cam_ref[c], state.t_cam_ref[c])
    return _most(_deviation(last.observations, state, c, start)) >= _LEAST_CORRECTED


def _is_distorted(one: _Deviation | None) -> bool:
    return one is not None and LENS[int(one.excess.argmax())] == "radial"


def _deviation(obs: Observations, state: BundleState, c: int, start: LensFit) -> _Deviation | None:
    """Measure how far the lens of a camera is from the one given; None where that is not known."""
    points = sighting(obs, state, c)
    if points is None:
        return None
    fit = fit_lens(points, start, radial=False)
    if (np.abs(fit.lens) > _SURE * _LIMITS).any():
        other = start_from_projection(points)
        if other is not None:
            again = fit_lens(points, other, radial=False)
            fit = min(fit, again, key=lambda one: one.median_px)
    return _measured(fit, fit_lens(points, fit, radial=True), points)


def _measured(fit: LensFit, radial: LensFit, points: Sighting) -> _Deviation:
    """Measure a fit without distortion, and that of one with it at the edge of what was seen."""
    edge = float(np.quantile((points.x**2).sum(1), _EDGE))
    values = np.append(fit.lens[:-1], radial.lens[-1] * edge)
    stddev = np.append(fit.stddev[:-1], radial.stddev[-1] * edge)
    certain = np.maximum(np.abs(values) - _DEVIATIONS * stddev, 0.0)
    known = stddev < _MAX_STDDEV
    return _Deviation(fit, values, np.where(known, certain / _LIMITS, 0.0))


def _without_the_worst(
    obs: Observations, state: BundleState, found: list[_Deviation | None], worst: int
) -> list[_Deviation | None]:
    """Measure all cameras again after the lens of one of them was corrected."""
    J = obs.observed.shape[2]
    rows = np.arange(0, len(obs.person), max(1, len(obs.person) * J // _MAX_POINTS))
    obs, state = obs.only(rows), state.only(rows)
    corrected = obs
    for _ in range(_ROUNDS):
        one = found[worst]
        if one is None:
            break
        corrected, start = _corrected(obs, state, worst, one.fit)
        state = adjust(corrected, start, iterations=_STEPS, tolerance=TOLERANCE)
        at = replace(
            one.fit, R_cam_ref=state.R_cam_ref[worst], t_cam_ref=state.t_cam_ref[worst], late_s=0.0
        )
        found[worst] = _deviation(obs, state, worst, at)
    pose = zip(state.R_cam_ref, state.t_cam_ref, strict=True)
    return [
        found[c] if c == worst else _deviation(corrected, state, c, as_given(R, t))
        for c, (R, t) in enumerate(pose)
    ]


def _corrected(
    obs: Observations, state: BundleState, c: int, fit: LensFit
) -> tuple[Observations, BundleState]:
    """Return the keypoints of a camera as by the lens that was fitted, and it at its place."""
    gain = np.exp(fit.lens[0] + fit.lens[1] * np.array([1.0, -1.0]))
    x = obs.x.copy()
    x[:, c] = (x[:, c] - fit.lens[2:4]) / gain
    focal = obs.focal.copy()
    focal[:, c] *= np.exp(fit.lens[0])
    R, t, shift = state.R_cam_ref.copy(), state.t_cam_ref.copy(), state.shift_s.copy()
    R[c], t[c] = fit.R_cam_ref, fit.t_cam_ref
    shift[c] += fit.late_s
    used = state.inlier.copy()
    used[:, c] = obs.observed[:, c]
    start = replace(state, R_cam_ref=R, t_cam_ref=t, shift_s=shift).with_inliers(used)
    return replace(obs, x=x, focal=focal), start


def _rejection(one: _Deviation, given: Intrinsics | None) -> Rejection:
    """Say what the keypoints look like."""
    k = int(one.excess.argmax())
    measured, limit = float(one.values[k]), float(_LIMITS[k])
    if _is_distorted(one) or given is None:
        reason = RejectionReason.DISTORTION_DISAGREES
        return Rejection(reason, (), measured, limit)
    K, (focal, aspect, x, y, _) = given.K, one.fit.lens
    scale = np.exp(focal + aspect * np.array([1.0, -1.0]))
    f, middle = np.diag(K)[:2], K[:2, 2]
    there = middle + f * np.array([x, y])
    corner = there - scale * (middle + 0.5) + 0.5
    exchanged = middle[::-1] - middle
    off = there - middle
    lengths = float(np.linalg.norm(off) * np.linalg.norm(exchanged))
    is_turned = LENS[k] in ("x", "y") and off @ exchanged > _TURNED * lengths > 0.0
    reason = RejectionReason.IMAGE_TURNED if is_turned else RejectionReason.IMAGE_RESIZED
    values = {
        "scale_x": scale[0],
        "scale_y": scale[1],
        "width": scale[0] * given.width,
        "height": scale[1] * given.height,
        "corner_x": corner[0],
        "corner_y": corner[1],
        "cx": there[0],
        "cy": there[1],
        "given_cx": middle[0],
        "given_cy": middle[1],
    }
    return Rejection(reason, (), measured, limit, values={n: float(v) for n, v in values.items()})
