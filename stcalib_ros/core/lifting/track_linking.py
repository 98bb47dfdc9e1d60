"""Tracks made from the poses of a camera alone, where its ids follow nobody.

Of two successive images the poses are assigned to each other that are nearest, all at once
(H. W. Kuhn, "The Hungarian method for the assignment problem", 1955), where the first are expected
to have gone on as before. What is further than a person moves begins a track of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from stcalib_ros.core.geometry.interpolation import frame_period
from stcalib_ros.core.geometry.robust import median_of_known
from stcalib_ros.core.lifting.limits import (
    LONGEST_BREAK_FRAMES,
    LONGEST_BREAK_S,
    MAX_ASTRAY,
    STRAY_SPEED,
    TRACK_JUMP,
    TRACK_SPEED,
)
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.keypoint_layouts import DETAILS
from stcalib_ros.core.model.recording import CameraRecording, Track

_FIT_POSES = 4
"""Poses by which the motion of a person is known. Numerical: a tenth of a second."""
_MAX_FOLLOWED = 64
"""Tracks that may go on at a time, count; of more, the latest. Numerical: bounds the cost."""
_LEAST_SIZE_PX = 1.0
"""px. A person is taken to be as large, also where all keypoints are at one place. Numerical."""
_FORBIDDEN = 1e6
"""Cost of an assignment that is not possible, sizes of a person; far above that of any other."""


@dataclass(frozen=True, slots=True, eq=False)
class _Poses:
    """All N poses of a camera, in the order of their images.

    Attributes
    ----------
    track, row : (N,) ndarray of int
        Where each of them is.
    time_s : (N,) ndarray
    points : (N, J, 2) ndarray
        Keypoints, px.
    size : (N,) ndarray
        Larger side of the box around them, px.
    frame : (N,) ndarray of int
    """

    track: IntArray
    row: IntArray
    frame: IntArray
    time_s: Float64Array
    points: Float64Array
    size: Float64Array


def linked(camera: CameraRecording) -> CameraRecording:
    """Return a camera with tracks by the places of its poses, whatever their ids.

    Parameters
    ----------
    camera : CameraRecording
    """
    if not camera.tracks:
        return camera
    poses = _poses(camera)
    longest_s = max(LONGEST_BREAK_S, LONGEST_BREAK_FRAMES * frame_period(camera.stamps))
    chains = _chains(poses, longest_s)
    tracks = tuple(_track(k, poses, np.array(chain), camera) for k, chain in enumerate(chains))
    return replace(camera, tracks=tracks)


def _poses(camera: CameraRecording) -> _Poses:
    columns = [j for j, name in enumerate(camera.layout.joint_names) if name not in DETAILS]
    frame = np.concatenate([track.frames for track in camera.tracks])
    lengths = [len(track.frames) for track in camera.tracks]
    order = np.argsort(frame, kind="stable")
    points = np.concatenate([t.keypoints[:, columns] for t in camera.tracks]).astype(np.float64)
    sides = np.fmax.reduce(points, axis=1) - np.fmin.reduce(points, axis=1)
    return _Poses(
        np.repeat(np.arange(len(lengths)), lengths)[order],
        np.concatenate([np.arange(n) for n in lengths])[order],
        frame[order],
        camera.stamps[frame[order]],
        points[order],
        np.fmax(*sides[order].T),
    )


def _chains(poses: _Poses, longest_s: float) -> list[list[int]]:
    """Return the poses of each person, in the order of time."""
    chains: list[list[int]] = []
    followed: list[int] = []
    for rows in np.split(np.arange(len(poses.frame)), np.flatnonzero(np.diff(poses.frame)) + 1):
        now_s = poses.time_s[rows[0]]
        followed = [k for k in followed if now_s - poses.time_s[chains[k][-1]] <= longest_s]
        followed = followed[-_MAX_FOLLOWED:]
        cost = _costs(poses, [chains[k] for k in followed], rows)
        begun = set(range(len(rows)))
        for a, b in zip(*linear_sum_assignment(cost), strict=True):
            if cost[a, b] < _FORBIDDEN:
                chains[followed[a]].append(int(rows[b]))
                begun.discard(int(b))
        for new in sorted(begun):
            followed.append(len(chains))
            chains.append([int(rows[new])])
    return chains


def _costs(poses: _Poses, chains: list[list[int]], rows: IntArray) -> Float64Array:
    """Distances (A, B) of poses from where persons are expected, in sizes of a person."""
    if not chains:
        return np.zeros((0, len(rows)))
    last = np.array([chain[-1] for chain in chains])
    first = np.array([chain[-_FIT_POSES:][0] for chain in chains])
    gap_s = (poses.time_s[rows[0]] - poses.time_s[last])[:, None]
    size = np.fmax(np.fmax(poses.size[last][:, None], poses.size[rows]), _LEAST_SIZE_PX)
    away = poses.points[rows] - poses.points[last][:, None]
    moved = poses.points[last] - poses.points[first]
    since_s = (poses.time_s[last] - poses.time_s[first])[:, None]
    known = np.isfinite(moved)
    mean = np.where(known, moved, 0.0).sum(1) / np.maximum(known.sum(1), 1)
    expected = away - (mean * gap_s / np.where(since_s > 0, since_s, 1.0))[:, None, None]
    moved_on = _distance(away) / size < TRACK_JUMP + TRACK_SPEED * gap_s
    astray = _distance(expected) / size
    return np.where(moved_on & (astray < MAX_ASTRAY + STRAY_SPEED * gap_s), astray, _FORBIDDEN)


def _distance(away: Float64Array) -> Float64Array:
    return median_of_known(np.linalg.norm(away, axis=-1))


def _track(k: int, poses: _Poses, chain: IntArray, camera: CameraRecording) -> Track:
    """Return the track of some poses."""
    parts = [(camera.tracks[int(poses.track[i])], int(poses.row[i])) for i in chain]
    return Track(
        k,
        poses.frame[chain],
        np.stack([track.keypoints[row] for track, row in parts]),
        np.stack([track.joints[row] for track, row in parts]),
        np.stack([track.scores[row] for track, row in parts]),
    )
