"""Small scenes, and recordings with a single change."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from stcalib_ros.core.evaluation.metrics import Evaluation, evaluate
from stcalib_ros.core.geometry.so3 import log_so3
from stcalib_ros.core.lifting.lift import lift_recording
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import CameraRecording, Recording, Track
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.model.skeleton import Skeleton, common_skeleton
from stcalib_ros.core.options import Options
from stcalib_ros.core.synthetic import Scene, SceneOptions
from stcalib_ros.core.validation.camera_checks import CameraChecks

FPS = 30.0
FRAME_S = 1 / FPS

EXACT = SceneOptions(
    n_frames=80,
    max_offset_frames=0,
    sigma_px=0,
    lifter_mm=(0, 0),
    tilt_deg=0,
    crop_perspective=0,
    scale_error=0,
    flip_rate=0,
    id_switches_per_10s=0,
)
"""No errors at all, and one clock."""

SMALL = SceneOptions(n_frames=80, n_cameras=3, n_people=2, id_switches_per_10s=0)
"""Cheap, with the errors of a usual detector and lifter."""

HALF_SECOND = Options(offset_range_s=0.5)
SOUND = CameraChecks(
    inliers=5000,
    inlier_fraction=0.95,
    explained_fraction=0.9,
    shared_s=8.0,
    rotation_stddev=0.001,
    position_stddev=0.002,
    offset_stddev_frames=0.01,
    bone_rotation=0.05,
    depth_ratio=1.0,
    limb_variation=0.02,
    offset_peak_ratio=6.0,
    alternative_offset_s=0.4,
)
"""Checks of a reliable camera."""

Changes = Callable[[CameraRecording], CameraRecording]


def changed(recording: Recording, name: str, change: Changes) -> Recording:
    """The recording with one camera replaced."""
    cameras = tuple(change(c) if c.name == name else c for c in recording.cameras)
    return replace(recording, cameras=cameras)


def every(recording: Recording, change: Changes) -> Recording:
    return replace(recording, cameras=tuple(change(c) for c in recording.cameras))


def clock_shifted(seconds: float) -> Changes:
    """A clock that is ahead by so many seconds."""
    return lambda camera: replace(camera, stamps=camera.stamps + seconds)


def tracks_changed(change: Callable[[Track], Track]) -> Changes:
    return lambda camera: replace(camera, tracks=tuple(change(t) for t in camera.tracks))


def whole_frame_offsets(scene: Scene, frames: tuple[int, ...]) -> Recording:
    """A scene recorded by one clock, with clocks that are off by whole frames."""
    recording = scene.recording
    for camera, n in zip(recording.cameras, frames, strict=True):
        recording = changed(recording, camera.name, clock_shifted(-n * FRAME_S))
    return recording


def lifted(recording: Recording) -> tuple[Skeleton, tuple[LiftedCamera, ...]]:
    skeleton = common_skeleton(recording)
    return skeleton, lift_recording(recording, skeleton, min_score=0.3)


def true_rig(scene: Scene) -> Rig:
    cameras = scene.truth.cameras
    return Rig(
        np.arange(len(cameras)),
        np.stack([c.R_ref_cam for c in cameras]),
        np.stack([c.t_ref_cam for c in cameras]),
        np.array([c.time_offset_s for c in cameras]),
        1.0,
    )


def error(calibration: Calibration, truth: Calibration) -> Evaluation:
    return evaluate(calibration, truth, fps=FPS)


def parameters(calibration: Calibration, names: list[str] | None = None) -> np.ndarray:
    """Poses and offsets (C, 7) in the frame and clock of the first of the names, its unit too.

    The unit is the distance of the first two; columns are centre, rotation vector and seconds.
    """
    by_name = {c.name: c for c in calibration.cameras}
    cameras = [by_name[n] for n in names or list(by_name)]
    first = cameras[0]
    unit = np.linalg.norm(cameras[1].t_ref_cam - first.t_ref_cam)
    return np.array(
        [
            [
                *first.R_ref_cam.T @ (c.t_ref_cam - first.t_ref_cam) / unit,
                *log_so3(first.R_ref_cam.T @ c.R_ref_cam),
                c.time_offset_s - first.time_offset_s,
            ]
            for c in cameras
        ]
    )
