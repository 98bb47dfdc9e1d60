"""What a calibration says of a case, compared with what is true."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from benchmarks.accuracy.scenarios import SUCCESS
from benchmarks.field.case import Answer, Case
from stcalib_ros.core.evaluation.metrics import evaluate
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration, Status
from stcalib_ros.core.model.rejection import RemarkCode

MAX_OFFSET_FRAMES = 0.5
"""Frames. A corrected stamp that is further from the true time than this is wrong. From the
project's requirements, like the bounds of rotation and position in `SUCCESS`."""
MAX_SCALE_ERROR = 0.2
"""Fraction. A unit that is called metres and is off by more is wrong: four times the standard
deviation of the size of an adult. Derived."""
MAX_DEVIATIONS = 6.0
"""Standard deviations. An error beyond them, and beyond `MIN_ROTATION`, is not what was said.
Chosen: six do not occur by chance in some hundred cases."""
MIN_ROTATION = 0.002
"""Radians. A smaller error is no matter, however small the deviation that was said. Chosen: a tenth
of what is wrong by `SUCCESS`."""
MIN_TIMED = 0.97
"""Fraction of the images of a camera whose corrected stamps have to be right: single stamps that
jitter are not the clock's error. Chosen."""
MIN_SIDE = 0.3
"""Fraction of the images of a camera whose stamps are right, of a calibration that says that it
holds for one side of a change only. Chosen: changes of the cases are in the middle half."""

_USUAL = {"LEAST_CONSTRAINED_CAMERA", "SHARE_MORE_VIEW", "MOVE_FASTER", "RECORD_LONGER"}
"""Remarks that good recordings have, too."""
INPUT_ERROR = "INPUT_ERROR"
"""Code of a recording that was refused while it was read."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Answer of a calibration, with its largest errors.

    Attributes
    ----------
    answer : Answer
    rotation_rad : float
        Largest error of a rotation against the best of the truths, NaN without a result.
    position : float
        The same of a position, over the first true baseline.
    deviations : float
        Largest error of a rotation over the largest standard deviation that was said.
    worst_ms : float
        Largest error of a corrected stamp.
    scale : float
        Length of the result over the true one; NaN where the unit is not called metres.
    said : str
        What was said, in a line.
    """

    answer: Answer
    rotation_rad: float = float("nan")
    position: float = float("nan")
    deviations: float = float("nan")
    worst_ms: float = float("nan")
    scale: float = float("nan")
    said: str = ""


def judge(case: Case, found: Calibration, codes: Collection[str]) -> Finding:
    """Compare a calibration with the truth.

    Parameters
    ----------
    case : Case
    found : Calibration
    codes : collection of str
        Codes of reasons and remarks that name what is wrong.

    Returns
    -------
    Finding
        ``WRONG`` only for a calibration that may be used, and is not what it says.
    """
    said = f"{found.status.name}: {', '.join(sorted(_said(found)))}"
    named = {name for code, names in _said(found).items() if code in codes for name in names}
    is_named = bool(case.faulty & named) or not case.faulty
    if found.status is not Status.OK:
        of_all = any(not r.cameras and r.reason.value in codes for r in found.rejections)
        is_named = bool(case.faulty & named) or of_all or (not case.faulty and bool(named))
        return Finding(Answer.REFUSED if is_named else Answer.UNNAMED, said=said)
    errors = min((_pose_errors(found, truth) for truth in case.truths), key=lambda e: e[0])
    clocks = {c.name: _stamp_errors(case, found, c) for c in found.cameras}
    frames = {name: np.abs(e) / _period(case, name) for name, e in clocks.items()}
    scale = _scale(found, case.truths[0]) if case.metres_known and found.metric else float("nan")
    answer = _answer(case, errors, frames, scale, is_named=is_named)
    worst_ms = 1e3 * max(float(np.abs(e).max()) for e in clocks.values())
    return Finding(answer, *errors, worst_ms, scale, said)


def _answer(
    case: Case,
    errors: tuple[float, float, float],
    frames: dict[str, Float64Array],
    scale: float,
    *,
    is_named: bool,
) -> Answer:
    rotation, position, deviations = errors
    posed = rotation <= SUCCESS["E_R"] and not position > SUCCESS["E_t"]
    honest = deviations <= MAX_DEVIATIONS or rotation <= MIN_ROTATION
    sized = not abs(np.log(scale)) > np.log1p(MAX_SCALE_ERROR)
    right = {name: float((off <= MAX_OFFSET_FRAMES).mean()) for name, off in frames.items()}
    timed = all(share >= MIN_TIMED for share in right.values())
    missing = {camera.name for camera in case.recording.cameras} - frames.keys()
    if posed and honest and sized and timed:
        if not missing:
            moved = len(case.truths) > 1
            return (Answer.ONE_SIDE if is_named else Answer.WRONG) if moved else Answer.GOOD
        return Answer.LEFT_OUT if missing <= case.faulty and is_named else Answer.UNNAMED
    one_side = all(
        share >= (MIN_SIDE if name in case.faulty else MIN_TIMED) for name, share in right.items()
    )
    if posed and honest and sized and one_side and is_named and case.faulty:
        return Answer.ONE_SIDE
    return Answer.WRONG


def _said(found: Calibration) -> dict[str, set[str]]:
    """Return the codes of all reasons and remarks, with the cameras that they name."""
    said: dict[str, set[str]] = {}
    for rejection in found.reasons:
        said.setdefault(rejection.reason.value, set()).update(rejection.cameras)
    for remark in found.remarks:
        said.setdefault(remark.code.value, set()).update(remark.cameras)
    return {code: names for code, names in said.items() if code not in _USUAL}


def _pose_errors(found: Calibration, truth: Calibration) -> tuple[float, float, float]:
    """Largest rotation error, rad; position error; rotation error in standard deviations."""
    errors = evaluate(found, truth, fps=1.0)
    by_name = {camera.name: camera for camera in found.cameras}
    deviations = 0.0
    for one in errors.cameras:
        said = np.linalg.eigvalsh(by_name[one.name].covariance[3:, 3:])[-1]
        if one.rotation_rad > MIN_ROTATION:
            deviations = max(deviations, one.rotation_rad / max(float(np.sqrt(said)), 1e-9))
    rotation = max((one.rotation_rad for one in errors.cameras), default=0.0)
    position = max((one.translation for one in errors.cameras), default=0.0)
    return rotation, position, deviations


def _stamp_errors(case: Case, found: Calibration, camera: CameraCalibration) -> Float64Array:
    """Errors (N,) of the corrected stamps of a camera against the reference of the result, s."""
    own = _clock_error(case, found, camera)
    reference = next((c for c in found.cameras if c.name == found.reference), camera)
    of_reference = _clock_error(case, found, reference)
    times = case.times_s[camera.name]
    return np.asarray(own - np.interp(times, case.times_s[reference.name], of_reference))


def _clock_error(case: Case, found: Calibration, camera: CameraCalibration) -> Float64Array:
    stamps = case.camera(camera.name).stamps
    since = stamps + (case.recording.epoch_ns * 1e-9 - found.epoch_s)
    corrected = stamps + camera.time_offset_s + camera.clock_skew * since
    error: Float64Array = np.asarray(corrected - case.times_s[camera.name])
    # Of stamps that are said to come in bunches, the offset is said to hold on average.
    return np.full_like(error, error.mean()) if _is_evened(found, camera.name) else error


def _is_evened(found: Calibration, name: str) -> bool:
    evened = (r.cameras for r in found.remarks if r.code is RemarkCode.STAMPS_EVENED)
    return any(name in cameras for cameras in evened)


def _period(case: Case, name: str) -> float:
    return float(np.median(np.diff(case.times_s[name])))


def _scale(found: Calibration, truth: Calibration) -> float:
    """Lengths of the result over the true ones."""
    true = {camera.name: camera.t_ref_cam for camera in truth.cameras}
    names = [camera.name for camera in found.cameras if camera.name in true]
    ours = {camera.name: camera.t_ref_cam for camera in found.cameras}
    a = np.array([ours[name] for name in names])
    b = np.array([true[name] for name in names])
    spread = np.linalg.norm(a - a.mean(0)), np.linalg.norm(b - b.mean(0))
    return float(spread[0] / spread[1])
