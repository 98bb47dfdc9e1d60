"""Check of a calibration against a few seconds of observations."""

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
    N_CHANGES,
    ROTATION,
    SHIFT,
    ChangeFit,
    Finding,
    detect_changes,
)
from stcalib_ros.core.monitoring.limits import MIN_GAIN_TO_CORRECT, MIN_KEPT_FRACTION
from stcalib_ros.core.monitoring.matching import SpanObservations, associate_span
from stcalib_ros.core.monitoring.noise import Noise

_REFINEMENTS = 2
"""Further passes with the changes applied; two measure turns of 10 degrees and jumps of 0.15 s."""


@dataclass(frozen=True, slots=True, eq=False)
class Span:
    """Findings of one span of time.

    Attributes
    ----------
    start_s, end_s : float
        Limits of the span, reference clock, seconds since the Unix epoch.
    findings : mapping of str to Finding
        Finding of every camera with images.
    lead_s : mapping of str to float
        How far the stamps of cameras are ahead of those of the others, for cameras whose images
        arrive, but with stamps far from the span.
    noise : Noise
        Usual residuals, this span included.
    """

    start_s: float
    end_s: float
    findings: Mapping[str, Finding]
    lead_s: Mapping[str, float] = field(default_factory=dict)
    noise: Noise = field(default_factory=Noise)


def check_span(
    recording: Recording,
    calibration: Calibration,
    *,
    start_s: float,
    end_s: float,
    min_score: float,
    lead_s: Mapping[str, float] | None = None,
    noise: Noise | None = None,
) -> Span:
    """Check a calibration against the observations of a span of time.

    Parameters
    ----------
    recording : Recording
        Observations of that span.
    calibration : Calibration
    start_s, end_s : float
        Limits of the span, reference clock, seconds since the Unix epoch.
    min_score : float
        Joints with a lower score are not used.
    lead_s : mapping of str to float, optional
        See `Span`.
    noise : Noise, optional
        Usual residuals by the spans before this one.

    Raises
    ------
    InputError
        The layouts of the cameras have too little in common.
    """
    findings: dict[str, Finding] = {}
    noise = noise or Noise()
    if (obs := associate_span(recording, calibration, min_score=min_score)) is not None:
        usual = noise.px(obs.names)
        findings = _findings(obs, usual)
        for _ in range(_REFINEMENTS):
            changes = _worth_correcting(findings)
            if not changes:
                break
            better = with_changes(calibration, changes, obs.metres_per_unit)
            again = associate_span(recording, better, min_score=min_score)
            if again is None or not _refine(findings, _findings(again, usual), changes):
                break
        noise = noise.after(obs.names, _left_px(obs.names, findings))
    return Span(start_s, end_s, findings, dict(lead_s or {}), noise)


def with_changes(
    calibration: Calibration, changes: Mapping[str, Float64Array], metres_per_unit: float
) -> Calibration:
    """Apply changes (7,) of cameras, see `ChangeFit.change`, to a calibration."""

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


def _findings(obs: SpanObservations, noise: Float64Array) -> dict[str, Finding]:
    return dict(zip(obs.names, detect_changes(obs, noise), strict=True))


def _left_px(names: Sequence[str], findings: Mapping[str, Finding]) -> Float64Array:
    """Residuals (C, C) of every two cameras that the best change of either leaves, px."""
    left = np.stack([findings[name].fit.left_px for name in names])
    return np.asarray(np.fmin(left, left.T))


def _worth_correcting(findings: Mapping[str, Finding]) -> dict[str, Float64Array]:
    """Return the changes with a large gain, of rivals the one that gains most."""
    return {
        name: f.fit.change
        for name, f in findings.items()
        if f.fit.gain >= MIN_GAIN_TO_CORRECT
        and all(f.fit.gain >= findings[rival].fit.gain for rival in f.rivals)
    }


def _refine(
    findings: dict[str, Finding],
    again: Mapping[str, Finding],
    changes: Mapping[str, Float64Array],
) -> bool:
    """Add to the changes in `findings` what a pass with these changes applied has found.

    That pass interpolates at the corrected times and associates persons anew. Return whether any
    residual has become smaller.
    """
    refined = False
    for name in changes:
        first, rest = findings[name].fit, again[name].fit
        if rest.n_points >= MIN_KEPT_FRACTION * first.n_points and rest.after_px < first.after_px:
            findings[name] = replace(findings[name], fit=_composed(first, rest))
            refined = True
    return refined


def _composed(first: ChangeFit, rest: ChangeFit) -> ChangeFit:
    R = exp_so3(first.change[ROTATION])
    change = np.zeros(N_CHANGES)
    change[ROTATION] = log_so3(R @ exp_so3(rest.change[ROTATION]))
    change[SHIFT] = first.change[SHIFT] + R @ rest.change[SHIFT]
    change[CLOCK] = first.change[CLOCK] + rest.change[CLOCK]
    gain = first.gain + rest.gain
    return replace(rest, change=change, before_px=first.before_px, gain=gain)
