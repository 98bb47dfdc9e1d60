"""Scenes that are calibrated at their beginning and monitored afterwards, for `watch`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from stcalib_ros.core.model.calibration import Calibration, CameraCalibration, Status
from stcalib_ros.core.model.clocks import clock_correction
from stcalib_ros.core.model.recording import Recording, excerpt
from stcalib_ros.core.monitoring.alarms import Thresholds, Verdict, judge
from stcalib_ros.core.monitoring.limits import KEPT_SPANS, SPAN_S
from stcalib_ros.core.monitoring.spans import Span, check_span
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.synthetic import Scene, SceneOptions, simulate
from stcalib_ros.io.mocap import shipped_clips

FPS = 30.0
"""Frame rate of the simulated cameras, Hz."""
CALIBRATED_S = 30.0
"""Seconds of data for the calibration: the window of the live node."""
SKEW_PPM = 20.0
"""Largest difference of the rates of two clocks, parts per million: usual crystals."""
MIN_SCORE = 0.3
"""Score from which keypoints are used, that of the default options."""

ATTEMPTS = 5
"""Scenes that are simulated at most until one is calibrated."""

KINDS: dict[str, dict[str, Any]] = {
    "noise": {"id_switches_per_10s": 0.5},
    "bias": {"keypoint_bias_mm": 20.0, "occlusions": True, "id_switches_per_10s": 0.5},
    "crowd": {
        "n_people": 5,
        "area_radius_m": 2.5,
        "keypoint_bias_mm": 20.0,
        "occlusions": True,
        "missing": 0.25,
        "bursts_per_10s": 1.0,
        "id_switches_per_10s": 0.5,
    },
}


@dataclass(frozen=True, slots=True, eq=False)
class Calibrated:
    """Cameras with the calibration of their first seconds.

    Attributes
    ----------
    options : SceneOptions
    calibration : Calibration
    skew : mapping of str to float
        True rates of the clocks.
    kind : str
    n_refused : int
        Scenes that were simulated before, and refused.
    """

    options: SceneOptions
    calibration: Calibration
    skew: Mapping[str, float]
    kind: str
    n_refused: int

    @property
    def failure(self) -> str:
        """Why there is no calibration to monitor; empty if there is one."""
        found = self.calibration
        complete = found.status is Status.OK and len(found.cameras) == self.options.n_cameras
        return "" if complete else found.message


def calibrated(n_cameras: int, index: int) -> Calibrated:
    """Calibrate the beginning of a scene; where it is refused, of the next one."""
    kind = list(KINDS)[index % len(KINDS)]
    for attempt in range(ATTEMPTS):
        options = SceneOptions(
            seed=10_000 * n_cameras + 100 * attempt + index,
            n_cameras=n_cameras,
            n_frames=round(FPS * CALIBRATED_S),
            fps=FPS,
            skew_ppm=SKEW_PPM,
            **KINDS[kind],
        )
        scene = simulate(options, clips=shipped_clips())
        skew = {camera.name: camera.clock_skew for camera in scene.truth.cameras}
        found = Calibrated(options, _calibration(scene), skew, kind, attempt)
        if not found.failure:
            break
    return found


def _calibration(scene: Scene) -> Calibration:
    return calibrate(scene.recording)


@dataclass(frozen=True, slots=True)
class Timing:
    """When the spans take place: after a time, and with pauses between them, s."""

    after_s: float = 0.0
    pause_s: float = 0.0


def watched(
    recording: Recording,
    calibration: Calibration,
    start_s: float,
    *,
    rates: Mapping[str, float] | None = None,
    timing: Timing | None = None,
) -> Iterator[tuple[float, dict[str, Verdict]]]:
    """End of every span, seconds since the epoch of the recording, and the verdicts after it.

    Parameters
    ----------
    recording : Recording
    calibration : Calibration
    start_s : float
        Begin of the first span.
    rates : mapping of str to float, optional
        Rates of clocks by which their stamps change until the spans take place; default: none.
    timing : Timing, optional
        Default: one span after the other.
    """
    timing = timing or Timing()
    offsets = {camera.name: camera.time_offset_s for camera in calibration.cameras}
    if timing.after_s:
        start = recording.epoch_ns * 1e-9 + start_s
        offsets = {
            c.name: _correction_s(c, start - calibration.epoch_s) for c in calibration.cameras
        }
    verdicts = {camera.name: Verdict(camera.name) for camera in calibration.cameras}
    spans: list[Span] = []
    for k in range(int((recording.cameras[0].stamps[-1] - start_s) / SPAN_S)):
        begin_s = start_s + SPAN_S * k
        later_s = timing.after_s + k * timing.pause_s
        part = excerpt(recording, begin_s, begin_s + SPAN_S, offsets_s=offsets)
        part = later(part, rates or {}, later_s)
        epoch_s = part.epoch_ns * 1e-9
        span = check_span(
            part,
            calibration,
            start_s=epoch_s + begin_s,
            end_s=epoch_s + begin_s + SPAN_S,
            min_score=MIN_SCORE,
            noise=spans[-1].noise if spans else None,
        )
        spans = [*spans, span][-KEPT_SPANS:]
        verdicts = judge(spans, verdicts, Thresholds())
        yield begin_s + SPAN_S, verdicts


def _correction_s(camera: CameraCalibration, since_epoch_s: float) -> float:
    return clock_correction(camera.time_offset_s, camera.clock_skew, since_epoch_s)


def later(recording: Recording, rates: Mapping[str, float], later_s: float) -> Recording:
    """Return what cameras record of the same people when so much time has passed."""
    cameras = tuple(
        replace(c, stamps=c.stamps - later_s * rate / (1.0 + rate))
        for c in recording.cameras
        for rate in (rates.get(c.name, 0.0),)
    )
    return replace(recording, cameras=cameras, epoch_ns=recording.epoch_ns + round(later_s * 1e9))


def with_rates(calibration: Calibration, rates: Mapping[str, float]) -> Calibration:
    """Return a calibration that knows the rates; its offsets hold in the middle of its data."""
    cameras = tuple(replace(c, clock_skew=rates[c.name]) for c in calibration.cameras)
    middle_s = 0.5 * sum(calibration.window_s)
    return replace(calibration, cameras=cameras, epoch_s=middle_s)
