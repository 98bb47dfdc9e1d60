"""Whether the keypoints of a camera are those of the lens that its CameraInfo describes.

A lens that is not that of the images bends the poses of all cameras a little. What every lens would
be if it were free is seen in the normal equations of the solved rig: the one that explains most is
freed, everything adjusted again, and so on, until what is left is noise. Only then is it said who
is wrong, and by how much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.lenses import focal_length
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark, RemarkCode
from stcalib_ros.core.validation.lens_hypotheses import (
    LENS,
    Hypothesis,
    LensSystem,
    LensTrial,
    lens_trial,
)

_MIN_SIGNIFICANCE = 6.5
"""Standard deviations that the lens of one camera, or one ratio of all focal lengths, explains, on
12,000 keypoints. Measured on right lenses (`benchmarks.field.lenses`): up to 3.7 on simulated
scenes of 17 kinds, 5.0 on real recordings. Of lenses that are wrong, without keypoint bias: a focal
length that is 5 % off 10.8 and more, a principal point that is 50 px off 8.0 and more."""
_MIN_OF_BOTH = 7.0
"""The same as the geometric mean of what is explained of corrected keypoints and of the given ones.
Measured: 6.0 on right real recordings (5.0 and 7.3), 7.6 and 8.9 on the same with a focal length
that is 20 % off (5.7 and 10.2, 5.9 and 13.5)."""
_ACCOMPLICE = 0.5
"""Ratio. A further lens is wrong, too, if it explains more than this fraction of what the first one
did. Measured: 0.1 to 0.25 beside one bad camera of four, 0.46 on a real recording; 0.8 and more
where all cameras have keypoints of three quarters."""
_LIMITS = np.array([0.08, 0.05, 0.05, 0.04, 0.03])
"""Certain deviations from which on a camera is left out: by `LENS`, distortion as the ratio at the
edge of what was seen. Derived from what they do to poses: a camera with a focal length that is 5 %
off is moved by 2.5 % of a baseline and turned by 0.009 rad, with 20 % by 11 % and 0.03 rad; one
with a principal point at 0.036 (50 px) is turned by 0.034 rad, which is the direction of its axis
and little else. A scene counts as solved up to 5 % and 0.02 rad in the mean."""
_NOTEWORTHY = 0.01
"""Certain deviations that are worth a remark, in all of `LENS`. Chosen: a calibration with a board
is known to half of it."""
_DEVIATIONS = 3.0
"""Standard deviations that a deviation has to be beyond a limit. Chosen: the usual ones."""
_EDGE = 0.95
"""Quantile of the distances from the axis that distortion is measured at. Chosen."""
_TURNED = 0.9
"""Cosine. A principal point that is off in the direction in which it is in the turned image is that
of an image turned by a quarter or by half. Chosen: 25 degrees."""


@dataclass(frozen=True, slots=True, eq=False)
class LensFault:
    """How far the lens of a camera is from the one given.

    Attributes
    ----------
    given : Intrinsics
    values, certain : (5,) ndarray
        Deviations by `LENS`, distortion at the edge of what was seen; and how far from zero they
        are at least.
    """

    given: Intrinsics
    values: Float64Array
    certain: Float64Array

    def is_beyond(self, limit: float | Float64Array) -> BoolArray:
        """Which deviations (5,) are certainly beyond a limit."""
        return np.asarray(self.certain > limit)


def lens_faults(
    cameras: Sequence[LiftedCamera], last: Iteration
) -> tuple[Rejection | Remark | None, ...]:
    """Return which cameras of a rig have another lens than the one given; None for the others.

    A remark where that does little harm.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    last : Iteration
    """
    members = [cameras[c] for c in last.rig.cameras]
    lenses = [camera.intrinsics for camera in members]
    given = [lens for lens in lenses if lens is not None]
    tested = np.array([camera.lens_knowledge is LensKnowledge.GIVEN for camera in members])
    nothing = (None,) * len(members)
    if len(given) < len(members) or not tested.any():
        return nothing
    found = _suspected(last, given, tested)
    if found is None:
        return nothing
    fit, found = _fitted(lens_trial(last.uncorrected or last, given, tested), found)
    return tuple(map(_said, _deviations(fit, found)))


def _suspected(
    last: Iteration, given: Sequence[Intrinsics], tested: BoolArray
) -> Hypothesis | None:
    """Return what is most significant; None where nothing is.

    Correcting keypoints for biases takes away what bias does, and a part of what a lens does.
    """
    found = _most_significant(last, given, tested)
    if last.uncorrected is None:
        return found if found.significance > _MIN_SIGNIFICANCE else None
    before = _most_significant(last.uncorrected, given, tested)
    both = float(np.sqrt(found.significance * before.significance))
    if found.significance > _MIN_SIGNIFICANCE or both > _MIN_OF_BOTH:
        return max(found, before, key=lambda one: one.significance)
    return None


def _most_significant(
    last: Iteration, given: Sequence[Intrinsics], tested: BoolArray
) -> Hypothesis:
    return LensSystem(lens_trial(last, given, tested)).best(Hypothesis(np.zeros_like(tested)))


def _fitted(tested: LensTrial, found: Hypothesis) -> tuple[LensTrial, Hypothesis]:
    """Free one lens after the other while that explains much."""
    fit = tested.fitted(found)
    least = max(_MIN_SIGNIFICANCE, _ACCOMPLICE * found.significance)
    for _ in range(len(tested.cameras)):
        further = LensSystem(fit).best(found)
        if further.significance < least:
            break
        found = further
        fit = fit.fitted(found)
    return fit, found


def _deviations(fit: LensTrial, found: Hypothesis) -> list[LensFault | None]:
    values, stddev = fit.corrections(), LensSystem(fit).stddev(found)
    obs, out = fit.part.observations, []
    for c, (lens, freed) in enumerate(zip(fit.given, found.cameras, strict=True)):
        seen = obs.observed[:, c]
        edge = np.quantile((obs.x[:, c][seen].astype(np.float64) ** 2).sum(-1), _EDGE)
        unit = np.where(np.array(LENS) == "radial", edge, 1.0)
        certain = np.maximum(np.abs(values[c]) - _DEVIATIONS * stddev[c], 0.0)
        out.append(LensFault(lens, unit * values[c], unit * certain) if freed else None)
    return out


def _said(fault: LensFault | None) -> Rejection | Remark | None:
    if fault is None or not fault.is_beyond(_NOTEWORTHY).any():
        return None
    if fault.is_beyond(_LIMITS).any():
        return _rejection(fault)
    return Remark(RemarkCode.LENS_DEVIATES, (), _noteworthy(fault))


def _noteworthy(fault: LensFault) -> dict[str, float]:
    """Numbers of what is certain of the lens."""
    given, (focal, x, y, radial, aspect) = fault.given, fault.values.tolist()
    is_focal, is_x, is_y, is_radial, is_aspect = fault.is_beyond(_NOTEWORTHY).tolist()
    cx, cy = given.K[:2, 2] + focal_length(given) * np.array([x, y])
    out = {"scale": float(np.exp(focal))} if is_focal else {}
    out |= {"ratio": float(np.exp(2.0 * aspect))} if is_aspect else {}
    if is_x or is_y:
        out |= {"cx": cx, "cy": cy, "given_cx": given.K[0, 2], "given_cy": given.K[1, 2]}
    out |= {"bent": radial} if is_radial else {}
    return {name: float(value) for name, value in out.items()}


def _rejection(fault: LensFault) -> Rejection:
    """Say what the keypoints look like."""
    k = int((fault.certain / _LIMITS).argmax())
    measured, limit = float(fault.values[k]), float(_LIMITS[k])
    if LENS[k] == "radial":
        return Rejection(RejectionReason.DISTORTION_DISAGREES, (), measured, limit)
    given, (focal, x, y, _, aspect) = fault.given, fault.values
    scale = np.exp(focal + aspect * np.array([1.0, -1.0]))
    middle = given.K[:2, 2]
    there = middle + focal_length(given) * np.array([x, y])
    corner = there - scale * (middle + 0.5) + 0.5
    is_turned = LENS[k] in ("x", "y") and _is_turned(fault)
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


def _is_turned(fault: LensFault) -> bool:
    """Whether the principal point is off to where a turn by a quarter or a half puts it."""
    given, off = fault.given, fault.values[1:3]
    cx, cy = given.K[:2, 2]
    for there in ((cy, cx), (given.width - 1.0 - cx, given.height - 1.0 - cy)):
        turned = there - given.K[:2, 2]
        lengths = float(np.linalg.norm(off) * np.linalg.norm(turned))
        if off @ turned > _TURNED * lengths > 0.0:
            return True
    return False
