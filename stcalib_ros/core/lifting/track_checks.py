"""Whether the track ids of a camera follow persons from image to image."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.geometry.interpolation import frame_period
from stcalib_ros.core.geometry.robust import median_of_known
from stcalib_ros.core.lifting.limits import (
    LONGEST_BREAK_FRAMES,
    LONGEST_BREAK_S,
    MIN_CONTINUED,
    MIN_TRACKED_POSES,
    TRACK_JUMP,
    TRACK_SPEED,
)
from stcalib_ros.core.lifting.read_camera import ReadCamera
from stcalib_ros.core.lifting.track_linking import linked
from stcalib_ros.core.model.arrays import FloatArray
from stcalib_ros.core.model.recording import CameraRecording, Track
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark, RemarkCode


def with_tracks(camera: CameraRecording) -> ReadCamera:
    """Return a camera with tracks that follow persons: its own, or else such as its poses make.

    A pose estimator without a tracker sends a new id for everybody in every image, or the place in
    its list, which changes from image to image.

    Parameters
    ----------
    camera : CameraRecording
    """
    continued = continued_fraction(camera)
    if not continued < MIN_CONTINUED:
        return ReadCamera(camera)
    made = linked(camera)
    after = continued_fraction(made)
    if after < MIN_CONTINUED:
        reason = RejectionReason.IDS_ARE_NO_TRACKS
        fault = Rejection(reason, (camera.name,), after, MIN_CONTINUED)
        return ReadCamera(camera, fault=fault)
    values = {"continued": continued, "limit": MIN_CONTINUED, "n_tracks": len(made.tracks)}
    return ReadCamera(made, (Remark(RemarkCode.IDS_LINKED, (camera.name,), values),))


def continued_fraction(camera: CameraRecording) -> float:
    """Return the fraction of poses that go on from the pose before of the same id.

    The first image with anybody has none before. NaN where there are too few poses.
    """
    tracks = [track for track in camera.tracks if len(track.frames)]
    n_poses = sum(len(track.frames) for track in tracks)
    if not tracks or n_poses < MIN_TRACKED_POSES:
        return float("nan")
    first = min(int(track.frames[0]) for track in tracks)
    begun = sum(int(track.frames[0]) == first for track in tracks)
    continued = sum(_continued(track, camera) for track in tracks)
    return continued / max(n_poses - begun, 1)


def _continued(track: Track, camera: CameraRecording) -> int:
    """Count the poses of a track that are near the one before, in time and in the image."""
    if len(track.frames) < 2:
        return 0
    gap = np.diff(camera.stamps[track.frames])
    moved = np.linalg.norm(np.diff(track.keypoints, axis=0), axis=-1)
    near = median_of_known(moved) < (TRACK_JUMP + TRACK_SPEED * gap) * _size(track.keypoints)
    known = np.isfinite(moved).any(-1)
    longest = max(LONGEST_BREAK_S, LONGEST_BREAK_FRAMES * frame_period(camera.stamps))
    return int(((near | ~known) & (gap <= longest)).sum())


def _size(keypoints: FloatArray) -> float:
    """Return the usual larger side of the box around a person's keypoints, px."""
    sides = [
        np.fmax.reduce(keypoints[..., k], axis=1) - np.fmin.reduce(keypoints[..., k], axis=1)
        for k in (0, 1)
    ]
    largest = np.fmax(*sides)
    known = largest[np.isfinite(largest)]
    return float(np.median(known)) if len(known) else 0.0
