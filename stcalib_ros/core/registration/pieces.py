"""Tracks cut where they jump from one person to another, with left and right as they were before.

A tracker that exchanges two people, and a pose estimator that exchanges left and right, are seen in
the keypoints of one camera alone: joints do not jump.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack
from stcalib_ros.core.registration.limits import (
    JUMP_FACTOR,
    JUMP_FRACTION,
    MAX_FLIP_S,
    MAX_GAP_S,
    MAX_PIECE_FRAMES,
    MAX_PIECES,
    MIN_FLIP_PX,
    MIN_FLIPPED_JOINTS,
    MIN_PIECE_FRAMES,
    MIRRORED_FRACTION,
)

_NEIGHBOURS = 3
"""Frames to each side by which the usual motion at a frame is known. Numerical: a tenth of a second
to each side, in which limbs hardly change their speed."""


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """The pieces of all tracks of a camera.

    Attributes
    ----------
    camera : LiftedCamera
        Its tracks are the pieces.
    track : (P,) ndarray of int
        Index of the track of which each piece is a part.
    """

    camera: LiftedCamera
    track: IntArray


def cut_tracks(camera: LiftedCamera, layout: Layout) -> Pieces:
    """Cut the tracks of a camera where all joints jump, and undo short exchanges of left and right.

    Parameters
    ----------
    camera : LiftedCamera
    layout : Layout
        Layout of its joints.
    """
    mirrored = mirrored_joints(layout)
    pieces, track = [], []
    for p, whole in enumerate(camera.tracks):
        times = camera.stamps[whole.frames]
        # In this order: where the sides change places, most joints jump.
        for piece in _between_jumps(_unmirrored(whole, times, mirrored), times):
            pieces.append(piece)
            track.append(p)
    return Pieces(replace(camera, tracks=tuple(pieces)), np.array(track, dtype=np.int64))


def whole_tracks(camera: LiftedCamera) -> Pieces:
    """Return the tracks of a camera as they are."""
    return Pieces(camera, np.arange(len(camera.tracks)))


def longest(pieces: Pieces) -> Pieces:
    """Keep the longest pieces of a camera, as many as registration can look at.

    They are compared with those of other cameras one by one, and each is held over the time of the
    longest.
    """
    tracks = pieces.camera.tracks
    lengths = np.array([len(track.frames) for track in tracks], dtype=np.int64)
    order = np.argsort(-lengths, kind="stable")
    n = min(MAX_PIECES, MAX_PIECE_FRAMES // max(1, int(lengths.max(initial=1))))
    kept = np.sort(order[: max(1, n)])
    camera = replace(pieces.camera, tracks=tuple(tracks[k] for k in kept))
    return Pieces(camera, pieces.track[kept])


def mirrored_joints(layout: Layout) -> IntArray:
    """Return the index (J,) of the joint of the other side; of joints without a side their own."""
    names = layout.joint_names
    other = {"left": "right", "right": "left"}
    opposite = ["_".join(other.get(word, word) for word in name.split("_")) for name in names]
    return np.array([names.index(o) if o in names else j for j, o in enumerate(opposite)])


def _between_jumps(track: LiftedTrack, times: Float64Array) -> Iterator[LiftedTrack]:
    """Yield the stretches of a track in which no two successive frames are of two people."""
    if len(times) < MIN_PIECE_FRAMES:
        return
    pixels = track.x * track.focal[..., None]
    moved = _row_median(np.linalg.norm(np.diff(pixels, axis=0), axis=-1))
    with np.errstate(invalid="ignore"):
        height = np.nanmax(pixels[..., 1], 1) - np.nanmin(pixels[..., 1], 1)
    limit = JUMP_FACTOR * _usual_nearby(moved) + JUMP_FRACTION * float(np.nanmedian(height))
    jumps = (moved > limit) | (np.diff(times) > MAX_GAP_S)
    edges = [0, *(np.flatnonzero(jumps) + 1).tolist(), len(times)]
    for begin, end in pairwise(edges):
        if end - begin >= MIN_PIECE_FRAMES:
            yield track[begin:end]


def _row_median(values: Float64Array) -> Float64Array:
    """Return the median of the finite values of every row, zero where there are none."""
    ordered = np.sort(values, axis=-1)
    count = np.isfinite(ordered).sum(-1)
    middle = np.take_along_axis(ordered, np.maximum(count - 1, 0)[:, None] // 2, -1)[:, 0]
    return np.where(count > 0, middle, 0.0)


def _usual_nearby(moved: Float64Array) -> Float64Array:
    """Return the median (F,) of the values beside each, itself left out."""
    n = _NEIGHBOURS
    padded = np.pad(moved, n, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * n + 1)
    return np.asarray(np.median(np.delete(windows, n, axis=1), axis=1))


def _unmirrored(track: LiftedTrack, times: Float64Array, mirrored: IntArray) -> LiftedTrack:
    """Exchange left and right back where they were exchanged for a short time."""
    flipped = _flipped(track, times, mirrored)
    if not flipped.any():
        return track
    x, focal = track.x.copy(), track.focal.copy()
    x[flipped], focal[flipped] = x[flipped][:, mirrored], focal[flipped][:, mirrored]
    return replace(track, x=x, focal=focal)


def _flipped(track: LiftedTrack, times: Float64Array, mirrored: IntArray) -> BoolArray:
    """Frames (F,) between two near ones at which the sides change places."""
    sided = np.flatnonzero(mirrored != np.arange(len(mirrored)))
    pixels = track.x * track.focal[..., None]
    before, after = pixels[:-1], pixels[1:]
    as_is = np.linalg.norm(after - before, axis=-1)[:, sided]
    exchanged = np.linalg.norm(after[:, mirrored] - before, axis=-1)[:, sided]
    both = np.isfinite(as_is) & np.isfinite(exchanged)
    count = both.sum(1)
    way, other_way = (np.where(both, d, 0.0).sum(1) for d in (as_is, exchanged))
    toggles = (
        (other_way < MIRRORED_FRACTION * way)
        & (way - other_way > MIN_FLIP_PX * count)
        & (count >= MIN_FLIPPED_JOINTS)
    )
    at = (np.flatnonzero(toggles) + 1).tolist()
    flipped = np.zeros(len(times), dtype=bool)
    while len(at) > 1:
        begin, end = at[:2]
        short = times[end] - times[begin] < MAX_FLIP_S
        flipped[begin:end] = short
        at = at[2 if short else 1 :]
    return flipped
