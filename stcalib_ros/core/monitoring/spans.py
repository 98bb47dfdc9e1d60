"""A few seconds of images, held to a calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from stcalib_ros.core.geometry.so3 import exp_so3, log_so3
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.monitoring.change_detection import (
    CLOCK,
    ROTATION,
    SHIFT,
    Finding,
    Fit,
    detect_changes,
)
from stcalib_ros.core.monitoring.limits import MIN_KEPT_POINTS, WORTH_CORRECTING
from stcalib_ros.core.monitoring.matching import SpanObservations, associate_span

SPAN_S = 2.0
"""Length of a span of time that is looked at as one."""
_REFINEMENTS = 2
"""Times that persons are associated again by the changed calibration. Numerical: bounds the
cost."""


@dataclass(frozen=True, slots=True, eq=False)
class Span:
    """What one span of time says.

    Attributes
    ----------
    start_s, end_s : float
        By the reference clock, seconds since the Unix epoch.
    findings : mapping of str to Finding
        By camera; of those that had images.
    away_s : mapping of str to float
        Of cameras whose images do arrive, but with stamps so far ahead of those of the others.
    """

    start_s: float
    end_s: float
    findings: Mapping[str, Finding]
    away_s: Mapping[str, float] = field(default_factory=dict)


def check_span(
    recording: Recording,
    calibration: Calibration,
    *,
    start_s: float,
    end_s: float,
    min_score: float,
    away_s: Mapping[str, float] | None = None,
) -> Span:
    """Hold the images of a span of time to a calibration.

    Parameters
    ----------
    recording : Recording
        The images of that span.
    calibration : Calibration
    start_s, end_s : float
        Of the span, reference clock, seconds since the Unix epoch.
    min_score : float
        Joints with a lower score are not used.
    away_s : mapping of str to float, optional
        See `Span`.

    Raises
    ------
    InputError
        The layouts of the cameras have too little in common.
    """
    findings: dict[str, Finding] = {}
    if (seen := associate_span(recording, calibration, min_score=min_score)) is not None:
        findings = _explained(seen, calibration)
        for _ in range(_REFINEMENTS):
            changes = _worth_correcting(findings)
            if not changes:
                break
            better = with_changes(calibration, changes, seen.metres_per_unit)
            again = associate_span(recording, better, min_score=min_score)
            if again is None or not _refine(findings, _explained(again, calibration), changes):
                break
    return Span(start_s, end_s, findings, dict(away_s or {}))


def expected_residual_px(calibration: Calibration, names: Sequence[str]) -> Float64Array:
    """Epipolar distance (C, C), px rms, of every two cameras; of all where a pair has none."""
    index = {name: i for i, name in enumerate(names)}
    usual = calibration.reprojection_rms_px
    out = np.full((len(names), len(names)), usual if np.isfinite(usual) else 0.0)
    for pair in calibration.pairs:
        if {pair.camera_a, pair.camera_b} <= index.keys() and np.isfinite(pair.epipolar_rms_px):
            a, b = index[pair.camera_a], index[pair.camera_b]
            out[a, b] = out[b, a] = pair.epipolar_rms_px
    return out


def with_changes(
    calibration: Calibration, changes: Mapping[str, Float64Array], metres_per_unit: float
) -> Calibration:
    """The calibration as it would be after changes (7,) of cameras, as `Fit.change` has them."""

    def after(camera: CameraCalibration) -> CameraCalibration:
        change = changes.get(camera.name)
        if change is None:
            return camera
        R = camera.R_ref_cam
        return replace(
            camera,
            R_ref_cam=R @ exp_so3(change[ROTATION]),
            t_ref_cam=camera.t_ref_cam + R @ change[SHIFT] / metres_per_unit,
            time_offset_s=camera.time_offset_s + float(change[CLOCK]),
        )

    return replace(calibration, cameras=tuple(after(camera) for camera in calibration.cameras))


def _explained(seen: SpanObservations, calibration: Calibration) -> dict[str, Finding]:
    found = detect_changes(seen, expected_residual_px(calibration, seen.names))
    return dict(zip(seen.names, found, strict=True))


def _worth_correcting(findings: Mapping[str, Finding]) -> dict[str, Float64Array]:
    """Changes that gain much, of suspects the one that gains most."""
    return {
        name: f.fit.change
        for name, f in findings.items()
        if f.fit.gain >= WORTH_CORRECTING
        and all(f.fit.gain >= findings[rival].fit.gain for rival in f.rivals)
    }


def _refine(
    findings: dict[str, Finding],
    again: Mapping[str, Finding],
    changes: Mapping[str, Float64Array],
) -> bool:
    """Add to changes, in place, what is left of them where they are known already.

    The clock is read off between images again, and persons are found again. Returns whether
    anything fits better by that.
    """
    refined = False
    for name in changes:
        first, rest = findings[name].fit, again[name].fit
        if rest.n_points >= MIN_KEPT_POINTS * first.n_points and rest.after_px < first.after_px:
            findings[name] = replace(findings[name], fit=_composed(first, rest))
            refined = True
    return refined


def _composed(first: Fit, rest: Fit) -> Fit:
    R = exp_so3(first.change[ROTATION])
    change = np.zeros(7)
    change[ROTATION] = log_so3(R @ exp_so3(rest.change[ROTATION]))
    change[SHIFT] = first.change[SHIFT] + R @ rest.change[SHIFT]
    change[CLOCK] = first.change[CLOCK] + rest.change[CLOCK]
    gain = first.gain + rest.gain
    return replace(rest, change=change, before_px=first.before_px, gain=gain)
