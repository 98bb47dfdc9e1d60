"""One simulated camera: its clock and the output of detector, lifter and tracker."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.geometry.visibility import project_visible
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.recording import CameraRecording, Track
from stcalib_ros.core.synthetic import tracking
from stcalib_ros.core.synthetic.bias_forms import keypoint_bias
from stcalib_ros.core.synthetic.changes import CameraChange, poses_over_time, stamps_over_time
from stcalib_ros.core.synthetic.lifter import LifterErrors, lift
from stcalib_ros.core.synthetic.noise import child_rng
from stcalib_ros.core.synthetic.options import SceneOptions
from stcalib_ros.core.synthetic.people import PersonMotion
from stcalib_ros.core.synthetic.rigs import SceneRig
from stcalib_ros.core.synthetic.shutter import joints_by_row
from stcalib_ros.core.synthetic.skeleton import LAYOUT, MIRROR

_FLIP_S = (0.05, 0.3)
"""Seconds, range. Duration of an exchange of left and right. Chosen: a few frames."""
_BURST_S = (0.2, 0.8)
"""Seconds, range. Duration of a short loss of a person. Chosen: a passing occlusion."""
_MAX_JITTER_FRAMES = 0.45
"""Frames. Largest error of a timestamp, so that their order is kept."""
MIN_KEYPOINTS = 6
"""Keypoints in the image, count, from which on a person is detected. Chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class Clock:
    """Times of the images of a camera, by its own clock and by the reference clock.

    Attributes
    ----------
    stamps : (N,) ndarray
        Timestamps by the camera's clock, seconds since the epoch.
    exposures_s : (N,) ndarray
        Exposure times of these images by the reference clock.
    offset_s, skew : float
        ``t_ref = t_cam + offset_s + skew * t_cam``.
    """

    stamps: Float64Array
    exposures_s: Float64Array
    offset_s: float
    skew: float

    @staticmethod
    def random(
        rng: np.random.Generator, options: SceneOptions, fps: float, *, is_reference: bool
    ) -> Clock:
        """Return a random clock of one camera of a scene."""
        first_fps = options.fps[0] if isinstance(options.fps, tuple) else options.fps
        offset_s, skew = 0.0, 0.0
        drawn = rng.uniform(-1, 1, 2)
        if not is_reference:
            offset_s = float(drawn[0]) * options.max_offset_frames / first_fps
            skew = float(drawn[1]) * options.skew_ppm * 1e-6
        n = max(2, round(options.n_frames * fps / first_fps))
        nominal = np.arange(n) / fps
        jitter = options.stamp_jitter_s * rng.standard_normal(n)
        stamps = nominal + np.clip(jitter, -_MAX_JITTER_FRAMES / fps, _MAX_JITTER_FRAMES / fps)
        kept = rng.uniform(size=n) >= options.drop_rate
        kept[[0, -1]] = True
        return Clock(stamps[kept], (nominal + offset_s + skew * nominal)[kept], offset_s, skew)

    def changed(self, changes: Sequence[CameraChange]) -> Clock:
        """Return the clock with its jumps; offset and skew stay those from before."""
        stamps = stamps_over_time(self.stamps, self.exposures_s, changes)
        kept = np.isfinite(stamps)
        return Clock(stamps[kept], self.exposures_s[kept], self.offset_s, self.skew)


@dataclass(frozen=True, slots=True, eq=False)
class CameraObservation:
    """Recording of one simulated camera with its truth.

    Attributes
    ----------
    camera : CameraRecording
    track_persons : mapping of int to (F,) ndarray
        Per track id, the true person in each of its frames.
    n_keypoints : int
        Number of observed keypoints.
    noise_square_px2 : float
        Sum of their squared distances from the projections of the true joints.
    """

    camera: CameraRecording
    track_persons: Mapping[int, IntArray]
    n_keypoints: int
    noise_square_px2: float


def observe(
    rng: np.random.Generator,
    people_seed: IntArray,
    options: SceneOptions,
    rig: SceneRig,
    camera: int,
    clock: Clock,
    people: Sequence[PersonMotion],
    changes: Sequence[CameraChange] = (),
) -> CameraObservation:
    """Simulate one camera of a rig.

    Parameters
    ----------
    rng : Generator
        Source of the errors of this camera.
    people_seed : (n,) ndarray of int
        Seed of the errors that the cameras have in common: detector bias and size prior.
    options : SceneOptions
    rig : SceneRig
    camera : int
        Index into the rig.
    clock : Clock
    people : sequence of PersonMotion
    changes : sequence of CameraChange
        Changes of this camera; those of its clock are in `clock` already.
    """
    lens, times = rig.intrinsics[camera], clock.exposures_s
    R, t = poses_over_time(rig.R_cam_world[camera], rig.t_cam_world[camera], times, changes)
    line_s = options.line_times(len(rig.names))[camera]
    truth = np.stack([joints_by_row(p, times, R, t, lens, line_s) for p in people], axis=1)
    exact = project_visible(truth, lens)
    keypoints, joints = np.empty_like(exact), np.empty_like(truth)
    draws = [child_rng(rng) for _ in people]
    for p, own in enumerate(draws):
        common = np.random.default_rng([*people_seed, 1_000 + p])
        other = np.random.default_rng([*people_seed, 2_000 + p])
        size_m = 1e-3 * options.keypoint_bias_mm
        bias = keypoint_bias(options.keypoint_bias_form, common, other, size_m, camera=camera)
        keypoints[:, p] = project_visible(bias(truth[:, p]), lens)
        joints[:, p] = lift(own, times, truth[:, p], _lifter(own, common, options))
    keypoints += options.sigma_px * rng.standard_normal(keypoints.shape)
    visible = _visible(child_rng(rng), options, times, truth, keypoints)
    noise = (keypoints - exact)[visible]
    _flip(child_rng(rng), options, times, keypoints, joints)
    boxes = tracking.boxes_of(exact)
    ids = tracking.fragment_ids(times, visible)
    ids = tracking.switch_ids(child_rng(rng), times, ids, boxes, options.id_switches_per_10s / 10)
    scores = np.where(np.isnan(keypoints[..., 0]), 0.0, rng.uniform(0.7, 1.0, keypoints.shape[:-1]))
    tracks, persons = make_tracks(ids, keypoints, joints, scores)
    name = rig.names[camera]
    recording = CameraRecording(
        name, f"{name}_optical_frame", lens, LAYOUT, clock.stamps, tracks, metric=True
    )
    known = ~np.isnan(noise[..., 0])
    return CameraObservation(recording, persons, int(known.sum()), float(np.sum(noise[known] ** 2)))


def _lifter(
    own: np.random.Generator, common: np.random.Generator, options: SceneOptions
) -> LifterErrors:
    scale = 1 + options.scale_error * (
        np.sqrt(0.8) * common.standard_normal() + np.sqrt(0.2) * own.standard_normal()
    )
    return LifterErrors(
        mpjpe_m=1e-3 * own.uniform(*options.lifter_mm),
        depth_ratio=options.lifter_depth_ratio,
        tilt_rad=np.deg2rad(options.tilt_deg),
        crop=options.crop_perspective,
        scale=float(scale),
    )


def _visible(
    rng: np.random.Generator,
    options: SceneOptions,
    times: Float64Array,
    truth: Float64Array,
    keypoints: Float64Array,
) -> BoolArray:
    """Return who is detected when (T, P)."""
    n = keypoints.shape[1]
    visible = np.isfinite(keypoints[..., 0]).sum(axis=-1) >= MIN_KEYPOINTS
    visible &= ~tracking.missing_stretches(child_rng(rng), times, n, options.missing)
    visible &= ~tracking.bursts(child_rng(rng), times, n, options.bursts_per_10s / 10, _BURST_S)
    if options.occlusions:
        visible &= ~tracking.hidden_behind(tracking.boxes_of(keypoints), truth[:, :, 0, 2])
    return np.asarray(visible)


def _flip(
    rng: np.random.Generator,
    options: SceneOptions,
    times: Float64Array,
    keypoints: Float64Array,
    joints: Float64Array,
) -> None:
    """Exchange left and right for short stretches, in place."""
    rate = options.flip_rate / (0.5 * sum(_FLIP_S))
    flipped = tracking.bursts(rng, times, keypoints.shape[1], rate, _FLIP_S)
    keypoints[flipped] = keypoints[flipped][:, MIRROR]
    joints[flipped] = joints[flipped][:, MIRROR]


def make_tracks(
    ids: IntArray, keypoints: Float64Array, joints: Float64Array, scores: Float64Array
) -> tuple[tuple[Track, ...], dict[int, IntArray]]:
    """Make tracks, with the true persons of each, from the track id of every person in every frame.

    Parameters
    ----------
    ids : (T, P) ndarray of int
        -1 where the person is not observed; an id without frames has an empty track.
    keypoints : (T, P, J, 2) ndarray
    joints : (T, P, J, 3) ndarray
    scores : (T, P, J) ndarray
    """
    tracks, persons = [], {}
    for track_id in range(int(ids.max(initial=-1)) + 1):
        frames, person = np.nonzero(ids == track_id)
        at = frames, person
        tracks.append(
            Track(track_id, frames.astype(np.int64), keypoints[at], joints[at], scores[at])
        )
        persons[track_id] = person.astype(np.int64)
    return tuple(tracks), persons
