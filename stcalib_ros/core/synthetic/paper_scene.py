"""Scenes of the paper's own experiments: noise on the true 3D points ("Robustness to Noise")."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.visibility import project_visible
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.core.synthetic.clips import MotionClip
from stcalib_ros.core.synthetic.noise import child_rng
from stcalib_ros.core.synthetic.observe import (
    MIN_KEYPOINTS,
    CameraObservation,
    Clock,
    make_tracks,
)
from stcalib_ros.core.synthetic.options import SceneOptions
from stcalib_ros.core.synthetic.people import PersonMotion, make_people
from stcalib_ros.core.synthetic.rigs import SceneRig
from stcalib_ros.core.synthetic.scene import EPOCH_NS, Scene, make_rig, true_calibration
from stcalib_ros.core.synthetic.skeleton import LAYOUT


def paper_scene(
    options: SceneOptions | None = None,
    *,
    offset_frames: float | Sequence[float] = 5.0,
    hidden: Mapping[int, Sequence[int]] | None = None,
    clips: Sequence[MotionClip] = (),
    rng: np.random.Generator | None = None,
) -> Scene:
    """Simulate the paper's synthetic observations.

    The true joints are moved into the frame of each camera, and Gaussian noise is put on them so
    that their projections have an error of ``sigma_px`` per axis. Keypoints and 3D poses are of the
    same noisy points, and every person is one track: the paper takes the tracking as known.

    Parameters
    ----------
    options : SceneOptions, optional
        Cameras, people, frames, frame rate (one for all), ``sigma_px`` and ``seed``; its other
        errors are not simulated.
    offset_frames : float or sequence of float
        Time offset of every camera but the first, or of each of these.
    hidden : mapping of int to sequence of int, optional
        People that are never observed, by index of the camera.
    clips : sequence of MotionClip
        Motion capture to compose the people's motion of; without any it is procedural.
    rng : Generator, optional
        Takes the place of ``options.seed``.
    """
    options = options or SceneOptions()
    rng = np.random.default_rng(options.seed) if rng is None else rng
    rig = make_rig(child_rng(rng), options)
    clocks = _clocks(options, len(rig.names), offset_frames)
    span = (
        min(clock.exposures_s[0] for clock in clocks),
        max(clock.exposures_s[-1] for clock in clocks),
    )
    people = make_people(
        child_rng(rng), options.people, options.n_people, span, options.area_radius_m, clips
    )
    seen = [
        _observe(child_rng(rng), options, rig, c, clock, people, (hidden or {}).get(c, ()))
        for c, clock in enumerate(clocks)
    ]
    recording = Recording(tuple(s.camera for s in seen), EPOCH_NS)
    return Scene(
        options,
        recording,
        true_calibration(rig, clocks, seen, recording.epoch_ns),
        rig,
        people,
        tuple(clock.exposures_s for clock in clocks),
        {s.camera.name: s.track_persons for s in seen},
    )


def _clocks(
    options: SceneOptions, n_cameras: int, offset_frames: float | Sequence[float]
) -> list[Clock]:
    fps = options.rates(n_cameras)[0]
    given = np.atleast_1d(np.asarray(offset_frames, dtype=float))
    others = np.repeat(given, n_cameras - 1) if len(given) == 1 else given
    if len(others) != n_cameras - 1:
        raise InputError(
            f"offset_frames: {len(others)} offsets for {n_cameras - 1} cameras after the first"
        )
    nominal: Float64Array = np.arange(options.n_frames, dtype=np.float64) / fps
    return [Clock(nominal, nominal + d / fps, float(d) / fps, 0.0) for d in (0.0, *others)]


def _observe(
    rng: np.random.Generator,
    options: SceneOptions,
    rig: SceneRig,
    camera: int,
    clock: Clock,
    people: Sequence[PersonMotion],
    hidden: Sequence[int],
) -> CameraObservation:
    """Simulate one camera: noisy points, their projections, and one track for each person."""
    lens, R, t = rig.intrinsics[camera], rig.R_cam_world[camera], rig.t_cam_world[camera]
    truth = np.stack([person(clock.exposures_s) @ R.T + t for person in people], axis=1)
    focal = float(np.sqrt(lens.K[0, 0] * lens.K[1, 1]))
    metres = options.sigma_px * np.abs(truth[..., 2:]) / focal
    joints = truth + metres * rng.standard_normal(truth.shape)
    keypoints = project_visible(joints, lens)
    visible = np.isfinite(keypoints[..., 0]).sum(-1) >= MIN_KEYPOINTS
    visible[:, list(hidden)] = False
    ids = np.where(visible, np.arange(len(people)), -1)
    scores = np.isfinite(keypoints[..., 0]).astype(float)
    tracks, persons = make_tracks(ids, keypoints, joints, scores)
    name = rig.names[camera]
    recording = CameraRecording(
        name, f"{name}_optical_frame", lens, LAYOUT, clock.stamps, tracks, metric=True
    )
    noise = (keypoints - project_visible(truth, lens))[visible]
    known = np.isfinite(noise[..., 0])
    return CameraObservation(recording, persons, int(known.sum()), float(np.sum(noise[known] ** 2)))
