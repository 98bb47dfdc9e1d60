"""What the numbers of a calibration mean: each against what is usual, and a grade of all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.geometry.interpolation import frame_period
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.rejection import RemarkCode
from stcalib_ros.core.model.rejection_text import remark_sentence
from stcalib_ros.core.validation.thresholds import DEFAULT
from stcalib_ros.report.clocks import CameraClock
from stcalib_ros.report.content import ReportContent
from stcalib_ros.report.fits import KeypointFit

ESTIMATOR = (0.01, 0.03)
"""Fractions of a person's height. Scatter of good pose estimators: keypoints that people mark by
hand scatter by 1 % (eyes) to 5 % (hips) of it (the sigmas of COCO's keypoint task, for a person who
stands)."""
FEW = 0.7
"""Fraction of the keypoints that fit, below which something else than noise is likely: between
what is refused (`CheckThresholds.min_inlier_fraction`) and what sound recordings have, 0.8 to 1."""
UNEVEN = 2.0
"""Ratio of a camera's median error to that of all of them. Chosen: distances of people from the
cameras of one room seldom differ by more."""
NEAR_LIMIT = 0.5
"""Fraction of a limit of the checks, from which on a standard deviation is worth a remark."""
CLEAR = 1.5
"""Ratio of errors. A next best time offset, or a next best assignment of a person, that fits less
than so many times worse is worth a remark; refused are offsets below 1.2."""


@dataclass(frozen=True, slots=True)
class Checked:
    """One thing that was looked at.

    Attributes
    ----------
    good : bool
    text : str
        What was found and what it means, in sentences.
    """

    good: bool
    text: str


@dataclass(frozen=True, slots=True)
class Grade:
    """Verdict in a few words, and what it is based on."""

    title: str
    meaning: str
    good: bool
    findings: tuple[Checked, ...] = ()


_REFUSED = {
    Status.DEGENERATE: "the data does not determine the cameras",
    Status.INSUFFICIENT_DATA: "not enough data",
    Status.NOT_CONVERGED: "the adjustment did not converge",
}


_DISAGREES = (
    "A camera was moved or its clock was set since the calibration, or the recording is of other "
    "cameras: calibrate again."
)


def disagreeing(fits: Sequence[KeypointFit]) -> tuple[str, ...]:
    """Return the cameras of which fewer keypoints fit than a calibration accepts."""
    return tuple(fit.name for fit in fits if fit.share < DEFAULT.min_inlier_fraction)


def grade(
    content: ReportContent, fits: Sequence[KeypointFit], clocks: Sequence[CameraClock]
) -> Grade:
    """Return what a calibration is worth.

    Parameters
    ----------
    content : ReportContent
    fits : sequence of KeypointFit
    clocks : sequence of CameraClock
    """
    c = content.calibration
    if c.status is Status.CANCELLED:
        return Grade("Cancelled", "The calibration was stopped before its end.", good=False)
    if c.status is not Status.OK:
        what = "must not be used" if c.cameras else "could not be computed"
        meaning = f"Poses, time offsets and people {what}: the reasons are below."
        return Grade(f"Refused: {_REFUSED[c.status]}", meaning, good=False)
    found = [_complete(c), _errors(content, fits), _shares(fits), _even(fits), _certain(content)]
    found += [_offsets(clocks), _persons(c)]
    findings = tuple(one for one in found if one is not None)
    weak = sum(not one.good for one in findings)
    if content.from_result and (off := disagreeing(fits)):
        return Grade(_disagreement(fits, off), _DISAGREES, False, findings)
    if weak == 0:
        meaning = "Everything that was checked is as it should be."
        return Grade(
            "Calibrated, as precisely as the pose estimator allows", meaning, True, findings
        )
    points = "One point is" if weak == 1 else f"{weak} points are"
    meaning = f"The calibration can be used. {points} worth a look, marked with ! below."
    return Grade("Calibrated, with remarks", meaning, True, findings)


def _disagreement(fits: Sequence[KeypointFit], off: Sequence[str]) -> str:
    if len(fits) - len(off) < 2:
        return "This recording does not agree with the result"
    verb = "does" if len(off) == 1 else "do"
    return f"{', '.join(off)} {verb} not agree with the result"


def _complete(c: Calibration) -> Checked | None:
    if not c.uncalibrated:
        return None
    names = ", ".join(camera.name for camera in c.uncalibrated)
    return Checked(False, f"Without a pose: {names}. The reasons are below.")


def _errors(content: ReportContent, fits: Sequence[KeypointFit]) -> Checked | None:
    """What the reprojection error is, beside the size of the people in the images."""
    heights = [fit.person_px for fit in fits if math.isfinite(fit.person_px)]
    rms_px = math.nan if content.evidence is None else content.evidence.last.rms_px()
    if not math.isfinite(rms_px):
        return None
    if not heights:
        return Checked(True, f"Keypoints miss by {rms_px:.1f} px (rms).")
    height = float(np.median(heights))
    share, (least, most) = rms_px / height, ESTIMATOR
    text = (
        f"Keypoints miss by {rms_px:.1f} px (rms): {share:.1%} of the height of a "
        f"person, who is about {height:.0f} px tall in these images. Good pose estimators scatter "
        f"by {least:.0%} to {most:.0%}"
    )
    if share <= most:
        return Checked(True, f"{text}: this is as good as they allow.")
    return Checked(
        False,
        f"{text}: this is more. Small, blurred or half hidden people do that, and so do lenses "
        "that are not what CameraInfo says.",
    )


def _shares(fits: Sequence[KeypointFit]) -> Checked | None:
    n_fit, n_seen = sum(fit.n_fit for fit in fits), sum(fit.n_seen for fit in fits)
    if not n_seen:
        return None
    text = (
        f"{n_fit / n_seen:.0%} of the keypoints fit: {n_fit} of the {n_seen} of people whom two "
        "cameras or more see at the same time."
    )
    if n_fit / n_seen >= FEW:
        return Checked(True, text)
    return Checked(False, f"{text} That is few: see below which camera the others are of.")


def _even(fits: Sequence[KeypointFit]) -> Checked | None:
    known = [fit for fit in fits if math.isfinite(fit.median_px)]
    if len(known) < 2:
        return None
    usual = float(np.median([fit.median_px for fit in known]))
    off = [fit for fit in known if fit.median_px > UNEVEN * usual or fit.share < FEW]
    low, high = min(f.median_px for f in known), max(f.median_px for f in known)
    if not off:
        text = f"All cameras fit about equally well: half of their keypoints miss by {low:.1f}"
        return Checked(True, f"{text} to {high:.1f} px or less.")
    named = ", ".join(f"{f.name} ({f.median_px:.1f} px, {f.share:.0%} fit)" for f in off)
    return Checked(
        False,
        f"Worse than the others (median {usual:.1f} px): {named}. Check the lens, and that the "
        "keypoints are of the image that CameraInfo describes.",
    )


def _certain(content: ReportContent) -> Checked | None:
    """Say how certain the least certain camera is, as the checks of the calibration found it."""
    c = content.calibration
    code = RemarkCode.LEAST_CONSTRAINED_CAMERA
    remark = next((one for one in c.remarks if one.code is code), None)
    if remark is None:
        return None
    periods = {one.name: frame_period(one.stamps) for one in content.recording.cameras}
    clock_ms = 1e3 * periods.get(remark.cameras[0], math.inf) * DEFAULT.max_offset_stddev_frames
    level = max(
        math.radians(remark.values["rotation_stddev_deg"]) / DEFAULT.max_rotation_stddev,
        remark.values["position_stddev_percent"] / (100.0 * DEFAULT.max_position_stddev),
        remark.values.get("offset_stddev_ms", 0.0) / clock_ms,
    )
    sentence = remark_sentence(remark)
    text = f"{sentence[:1].upper()}{sentence[1:]} (one standard deviation)"
    if math.isfinite(c.scale_stddev):
        text += f"; the scale of all lengths is good to {100 * c.scale_stddev:.2g} %"
    if level < NEAR_LIMIT:
        return Checked(True, f"{text}.")
    return Checked(False, f"{text}. That is near the limit of what is accepted.")


def _offsets(clocks: Sequence[CameraClock]) -> Checked | None:
    if not clocks:
        return None
    known = [clock for clock in clocks if math.isfinite(clock.ratio)]
    if not known:
        return Checked(True, "Time offsets are distinct: no other one comes near.")
    least = min(known, key=lambda clock: clock.ratio)
    other_ms = 1e3 * float(least.difference_s[least.runner_up])
    text = (
        f"the next best one, of {least.name}, is {other_ms:+.0f} ms away, and the error there is "
        f"{least.ratio:.1f} times as large"
    )
    if least.ratio >= CLEAR:
        return Checked(True, f"Time offsets are distinct: {text}.")
    return Checked(
        False, f"A time offset is hardly distinct: {text}. People who move faster would help."
    )


def _persons(c: Calibration) -> Checked | None:
    if not c.persons:
        return None
    least = min(c.persons, key=lambda person: person.margin)
    if math.isinf(least.margin):
        return Checked(True, "Nobody could be taken for somebody else.")
    text = (
        f"if person {least.person_id} were taken for somebody else, keypoints would miss by "
        f"{least.margin:.1f} times as much"
    )
    if least.margin >= CLEAR:
        return Checked(True, f"Who is who is clear: {text}.")
    return Checked(False, f"Who is who is not quite clear: {text} only.")
