"""From the images of each camera to a `Recording`; serves bags and live topics alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.core.model.recording import CameraRecording, Recording, Track, unknown_joints
from stcalib_ros.io.keypoint_pixels import with_pixels
from stcalib_ros.io.lens_settings import LensSettings, lens_of_settings
from stcalib_ros.io.limits import MAX_REPEATED_IDS
from stcalib_ros.io.message_types import NO_TRACK
from stcalib_ros.io.messages import (
    NS,
    CameraInfoFields,
    Float32Array,
    PoseImage,
    format_stamp,
    lens,
)
from stcalib_ros.io.plausible import require_name

Warn = Callable[[str], None]

_NO_SETTINGS = LensSettings()


@dataclass(frozen=True, slots=True, eq=False)
class CameraImages:
    """What arrived of one camera.

    Attributes
    ----------
    name : str
    images : sequence of PoseImage
        In any order; at least one.
    info : CameraInfoFields
    pose_topic, info_topic : str
        For messages.
    frame_id : str or None
        Takes precedence over that of the messages.
    line_time_s : float
        Of its shutter, seconds per row.
    settings : LensSettings
        What is said of its lens beside CameraInfo.
    """

    name: str
    images: Sequence[PoseImage]
    info: CameraInfoFields
    pose_topic: str
    info_topic: str
    frame_id: str | None = None
    line_time_s: float = 0.0
    settings: LensSettings = _NO_SETTINGS


def assemble_recording(cameras: Sequence[CameraImages], *, warn: Warn) -> Recording:
    """Make a recording of what arrived, cameras in the given order.

    Stamps are ordered; of images with one stamp, and of persons with one track id in an image, the
    one with the higher score is kept. Both are counted and reported to `warn`. Where ids repeat in
    most of the images with several persons, nobody tracks them, and everyone gets an own id, as do
    persons without one.

    Raises
    ------
    InputError
        A camera changes its layout, its frame, ``rectified`` or ``metric`` on the way, its lens is
        unusable, or nothing at all was observed.
    """
    epoch_ns = min(image.stamp_ns for camera in cameras for image in camera.images) // NS * NS
    recording = Recording(tuple(_camera(c, epoch_ns, warn) for c in cameras), epoch_ns)
    _require_observations(recording, warn)
    _warn_shared_frames(recording, warn)
    return recording


def _camera(camera: CameraImages, epoch_ns: int, warn: Warn) -> CameraRecording:
    _require_constant(camera)
    images = _ordered(camera, warn)
    first = images[0]
    if n_infinite := sum(image.n_infinite for image in images):
        warn(f"{camera.pose_topic}: {n_infinite} infinite values are taken as not observed")
    given = lens(camera.info, rectified=first.rectified, topic=camera.info_topic)
    if first.rectified and not given.known and camera.settings.info is not None:
        raise InputError(
            f"camera {camera.name}: its keypoints are of rectified images, of which the file of "
            "its lens says nothing: give camera_info YAML, which has projection_matrix"
        )
    start, knowledge = lens_of_settings(given, camera.settings, warn, f"camera {camera.name}")
    images = [with_pixels(image, start, camera.info_topic) for image in images]
    stamps_ns = np.array([image.stamp_ns - epoch_ns for image in images], dtype=np.int64)
    return CameraRecording(
        name=require_name(camera.name, f"{camera.pose_topic}: camera"),
        frame_id=require_name(
            camera.frame_id or first.frame_id or f"{camera.name}_optical_frame",
            f"{camera.pose_topic}: frame_id",
        ),
        intrinsics=start,
        layout=first.layout,
        stamps=stamps_ns / NS,
        tracks=_tracks(camera.pose_topic, images, warn),
        metric=first.metric,
        line_time_s=camera.line_time_s,
        received=_received(images, epoch_ns),
        lens_knowledge=knowledge,
        lens_group=camera.settings.group,
    )


def _received(images: Sequence[PoseImage], epoch_ns: int) -> Float64Array | None:
    """Seconds since the epoch at which a recorder received images; None where nobody did."""
    times = [image.received_ns for image in images]
    if all(time is None for time in times):
        return None
    return np.array([np.nan if time is None else (time - epoch_ns) / NS for time in times])


def _require_constant(camera: CameraImages) -> None:
    first = camera.images[0]
    for image in camera.images:
        for field in ("layout", "rectified", "metric", "frame_id"):
            before, after = getattr(first, field), getattr(image, field)
            if before is not after and before != after:
                raise InputError(
                    f"{camera.pose_topic}: {field} changes from {_text(before)} (stamp "
                    f"{format_stamp(first.stamp_ns)}) to {_text(after)} (stamp "
                    f"{format_stamp(image.stamp_ns)}); do two cameras publish on this topic?"
                )


def _text(value: Layout | bool | str) -> str:
    if isinstance(value, Layout):
        return f"{value.name!r} with joints {', '.join(value.joint_names)}"
    return repr(value)


def _ordered(camera: CameraImages, warn: Warn) -> list[PoseImage]:
    """Images by stamp; of several with one stamp that with the highest scores."""
    best: dict[int, PoseImage] = {}
    for image in camera.images:
        other = best.get(image.stamp_ns)
        if other is None or image.scores.sum() > other.scores.sum():
            best[image.stamp_ns] = image
    if dropped := len(camera.images) - len(best):
        warn(
            f"{camera.pose_topic}: {dropped} images have the same timestamp as another one; "
            "those with the higher score are kept"
        )
    return [best[stamp] for stamp in sorted(best)]


def _tracks(topic: str, images: Sequence[PoseImage], warn: Warn) -> tuple[Track, ...]:
    counts = [len(image.track_ids) for image in images]
    if not any(counts):
        return ()
    frames = np.repeat(np.arange(len(images), dtype=np.int64), counts)
    ids = _with_own_ids(np.concatenate([image.track_ids for image in images]))
    scores: Float64Array = np.concatenate([image.scores for image in images])
    ids, order = _by_track(topic, frames, ids, scores, warn)
    keypoints = np.concatenate([image.keypoints for image in images])
    joints = _joints(images)
    joint_scores = np.concatenate([image.joint_scores for image in images])
    starts = np.flatnonzero(np.diff(ids[order])) + 1
    return tuple(
        Track(
            int(ids[rows[0]]),
            frames[rows],
            points := keypoints[rows],
            unknown_joints(points) if joints is None else joints[rows],
            joint_scores[rows],
        )
        for rows in np.split(order, starts)
    )


def _with_own_ids(ids: IntArray) -> IntArray:
    """Return ids in which every person whom nobody tracks has one that nobody else has.

    Before they are calibrated, such persons are linked by their places.
    """
    untracked = ids == NO_TRACK
    if not untracked.any():
        return ids
    free = np.setdiff1d(np.arange(len(ids), dtype=np.int64), ids[~untracked])
    return np.where(untracked, free[np.cumsum(untracked) - 1], ids)


def _by_track(
    topic: str, frames: IntArray, ids: IntArray, scores: Float64Array, warn: Warn
) -> tuple[IntArray, IntArray]:
    """Return the track ids of all persons, and those to keep in the order of track and image."""
    order = np.lexsort((-scores, frames, ids))
    same = (np.diff(ids[order]) == 0) & (np.diff(frames[order]) == 0)
    if not same.any():
        return ids, order
    n_repeated = len(np.unique(frames[order][1:][same]))
    n_several = int((np.bincount(frames) > 1).sum())
    if n_repeated > MAX_REPEATED_IDS * n_several:
        warn(
            f"{topic}: in {n_repeated} of {n_several} images with several people, some share a "
            "track id: ids are not used"
        )
        everyone = np.arange(len(ids), dtype=np.int64)
        return everyone, everyone
    warn(
        f"{topic}: {int(same.sum())} times, two people of one image have the same track id; those "
        "with the higher score are kept"
    )
    return ids, order[np.concatenate([[True], ~same])]


def _joints(images: Sequence[PoseImage]) -> Float32Array | None:
    """Return the 3D poses of all persons; None if nobody has one."""
    if all(image.joints is None for image in images):
        return None
    return np.concatenate(
        [unknown_joints(i.keypoints) if i.joints is None else i.joints for i in images]
    )


def _require_observations(recording: Recording, warn: Warn) -> None:
    """Say so if one camera, or every camera, has persons and not a single keypoint of them."""
    seeing = [camera for camera in recording.cameras if camera.tracks]
    blind = [c.name for c in seeing if not any(np.isfinite(t.keypoints).any() for t in c.tracks)]
    for name in blind:
        warn(f"camera {name}: all keypoints of all persons are NaN, infinite or (0, 0)")
    if blind and len(blind) == len(seeing):
        raise InputError(
            "all keypoints of all persons are NaN, infinite or (0, 0) in every camera "
            f"({', '.join(sorted(blind))}); check the pose estimator's output"
        )


def _warn_shared_frames(recording: Recording, warn: Warn) -> None:
    owner: dict[str, str] = {}
    for camera in recording.cameras:
        if (other := owner.setdefault(camera.frame_id, camera.name)) != camera.name:
            warn(
                f"cameras {other} and {camera.name} have one frame_id, {camera.frame_id!r}; "
                f"set camera.{camera.name}.frame"
            )
