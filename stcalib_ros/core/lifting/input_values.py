"""Scores in another range, keypoints that stand for "not detected", and images that repeat."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stcalib_ros.core.lifting.keypoint_checks import at_one_place, has_enough
from stcalib_ros.core.lifting.limits import (
    FROZEN_FRACTION,
    MIN_FROZEN_IMAGES,
    MIN_PERCENT,
    MIN_REPEATED_VALUE,
    MIN_REPEATING_JOINTS,
    ONE_PLACE_FRACTION,
)
from stcalib_ros.core.lifting.read_camera import ReadCamera
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.recording import CameraRecording, Track
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark, RemarkCode

_MAX_POINTS = 10_000
"""Keypoints of a camera among which values that repeat are looked for, about. Numerical: bounds
the cost."""
_PERCENT = 100.0
"""Scores per unit where they are given in percent. Definition."""


def with_scores_of_one(camera: CameraRecording, *, min_score: float) -> ReadCamera:
    """Return a camera with scores of 0..1; a fault where none reaches the limit.

    Parameters
    ----------
    camera : CameraRecording
    min_score : float
        Joints with a lower score are not used.
    """
    given = [t.scores[np.isfinite(t.keypoints).all(-1)] for t in camera.tracks]
    scores = np.concatenate(given) if given else np.zeros(0)
    scores = scores[np.isfinite(scores)]
    if not len(scores):
        return ReadCamera(camera)
    largest = float(scores.max())
    if largest < min_score:
        reason = RejectionReason.SCORES_BELOW_LIMIT
        return ReadCamera(camera, fault=Rejection(reason, (camera.name,), largest, min_score))
    if not MIN_PERCENT < largest <= _PERCENT:
        return ReadCamera(camera)
    tracks = tuple(replace(t, scores=t.scores / t.scores.dtype.type(100)) for t in camera.tracks)
    remark = Remark(RemarkCode.SCORES_IN_PERCENT, (camera.name,), {"largest": largest})
    return ReadCamera(replace(camera, tracks=tracks), (remark,))


def without_undetected(camera: CameraRecording, *, min_score: float) -> ReadCamera:
    """Return a camera without the keypoints at a place that stands for "not detected".

    Parameters are those of `with_scores_of_one`.
    """
    remarks = []
    for x, y in _repeated_places(camera):
        tracks, n_scored = [], 0
        for track in camera.tracks:
            there = np.asarray((track.keypoints == (x, y)).all(-1))
            n_scored += int((there & (track.scores >= min_score)).sum())
            points = track.keypoints.copy()
            points[there] = np.nan
            tracks.append(replace(track, keypoints=points))
        camera = replace(camera, tracks=tuple(tracks))
        if n_scored:
            values = {"n_points": n_scored, "x": x, "y": y}
            remarks.append(Remark(RemarkCode.KEYPOINTS_NOT_OBSERVED, (camera.name,), values))
    return ReadCamera(camera, tuple(remarks))


def _repeated_places(camera: CameraRecording) -> list[tuple[float, float]]:
    """Return places at which keypoints of many joints or none of the image are, to the last bit."""
    n_points = sum(track.scores.size for track in camera.tracks)
    stride = max(1, n_points // _MAX_POINTS)
    some = [track.keypoints[::stride] for track in camera.tracks]
    if not some:
        return []
    points = np.concatenate(some).astype(np.float64)
    points[at_one_place(points)] = np.nan  # those are nobody, and are said as such
    N, J = points.shape[:2]
    joint = np.broadcast_to(np.arange(J), (N, J))[known := np.isfinite(points).all(-1)]
    places, index, counts = np.unique(
        points[known][:, 0] + 1j * points[known][:, 1], return_inverse=True, return_counts=True
    )
    found = []
    for k in np.flatnonzero(counts >= MIN_REPEATED_VALUE * len(index)):
        x, y = float(places[k].real), float(places[k].imag)
        joints = len(np.unique(joint[index.ravel() == k]))
        outside = min(x, y) <= 0.0
        several = joints >= MIN_REPEATING_JOINTS * J
        if (outside or several) and joints > 1 and counts[k] < ONE_PLACE_FRACTION * len(index):
            found.append((x, y))
    return found


def without_repeated_images(camera: CameraRecording, *, min_score: float) -> ReadCamera:
    """Return a camera without the images in which everybody is as in the image before, to the bit.

    A driver or a decoder that hangs sends the same image again; its stamps are those of other
    moments.

    Parameters are those of `with_scores_of_one`.
    """
    seen, repeated = _repeated_images(camera, min_score)
    n_repeated, n_seen = int(repeated.sum()), int(seen.sum())
    if not n_repeated or n_seen < MIN_FROZEN_IMAGES:
        return ReadCamera(camera)
    if n_repeated > FROZEN_FRACTION * n_seen:
        reason = RejectionReason.STREAM_FROZEN
        fraction = n_repeated / n_seen
        return ReadCamera(
            camera, fault=Rejection(reason, (camera.name,), fraction, FROZEN_FRACTION)
        )
    kept = ~repeated
    number = np.cumsum(kept) - 1
    tracks = [_rows(track, kept[track.frames], number) for track in camera.tracks]
    whole = tuple(track for track in tracks if len(track.frames))
    values = {"n_repeated": n_repeated, "n_images": len(kept), "longest_s": _longest(camera, kept)}
    remark = Remark(RemarkCode.IMAGES_REPEATED, (camera.name,), values)
    return ReadCamera(replace(camera, stamps=camera.stamps[kept], tracks=whole), (remark,))


def _repeated_images(camera: CameraRecording, min_score: float) -> tuple[BoolArray, BoolArray]:
    """Return which images (N,) have anybody, and which of them repeat the one before."""
    N = len(camera.stamps)
    people, same = np.zeros(N, dtype=np.int64), np.zeros(N, dtype=np.int64)
    for track in camera.tracks:
        scored = (track.scores >= min_score)[..., None]
        full = has_enough(np.where(scored, track.keypoints, np.nan))
        people[track.frames[full]] += 1
        now, before = track.keypoints[1:], track.keypoints[:-1]
        equal = ((now == before) | (np.isnan(now) & np.isnan(before))).all((-1, -2))
        next_one = np.diff(track.frames) == 1
        same[track.frames[1:][equal & next_one & full[1:]]] += 1
    return people > 0, (people > 0) & (same == people)


def _longest(camera: CameraRecording, kept: BoolArray) -> float:
    """Return the longest time between two images that are not repeated, s."""
    times: Float64Array = np.append(camera.stamps[kept], camera.stamps[-1])
    return float(np.diff(times).max())


def _rows(track: Track, kept: BoolArray, number: IntArray) -> Track:
    return Track(
        track.track_id,
        number[track.frames[kept]],
        track.keypoints[kept],
        track.joints[kept],
        track.scores[kept],
    )
