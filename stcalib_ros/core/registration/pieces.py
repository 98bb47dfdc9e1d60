"""Tracks cut where they jump from one person to another, with left and right as they were before.

A tracker that exchanges two people, and a pose estimator that exchanges left and right, are seen in
the keypoints of one camera alone: joints do not jump.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from stcalib_ros.core.geometry.interpolation import LONGEST_BRIDGE_S, bridged
from stcalib_ros.core.geometry.robust import median_of_known
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack
from stcalib_ros.core.model.skeleton import mirrored_joints
from stcalib_ros.core.registration.limits import (
    JUMP_FACTOR,
    JUMP_FRACTION,
    MAX_FLIP_S,
    MAX_GAP_S,
    MAX_PIECE_FRAMES,
    MAX_PIECES,
    MIN_FLIP_PX,
    MIN_FLIPPED_JOINTS,
    MIN_LINK_FRAMES,
    MIN_PIECE_FRAMES,
    MIRRORED_FRACTION,
)
from stcalib_ros.core.registration.linking import chains, height_px

_NEIGHBOURS = 3
"""Frames to each side by which the usual motion at a frame is known. Numerical: a tenth of a second
to each side, in which limbs hardly change their speed."""


class TrackPart(NamedTuple):
    """A stretch of a track: its index, and the times of its first and last frame, seconds."""

    track: int
    begin_s: float
    end_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """The pieces of all tracks of a camera.

    Attributes
    ----------
    camera : LiftedCamera
        Its tracks are the pieces.
    parts : tuple of tuple of TrackPart
        Of which parts of tracks each piece is made.
    """

    camera: LiftedCamera
    parts: tuple[tuple[TrackPart, ...], ...]


def cut_tracks(camera: LiftedCamera, layout: Layout) -> Pieces:
    """Cut the tracks of a camera where all joints jump, and link what goes on elsewhere.

    Before, short exchanges of left and right are undone, at which most joints jump as well. At
    last, joints that are missing for a moment are filled in.

    Parameters
    ----------
    camera : LiftedCamera
    layout : Layout
        Layout of its joints.
    """
    mirrored = mirrored_joints(layout)
    pieces, parts = [], []
    for p, track in enumerate(camera.tracks):
        times = camera.stamps[track.frames]
        for piece in _between_jumps(_unmirrored(track, times, mirrored), times):
            pieces.append(piece)
            parts.append(_part(p, piece, camera.stamps))
    kept, members = [], []
    for chain in chains(pieces, camera.stamps):
        joined = _joined([pieces[k] for k in chain])
        if len(joined.frames) >= MIN_PIECE_FRAMES:
            kept.append(_filled(joined, camera.stamps[joined.frames]))
            members.append(tuple(parts[k] for k in chain))
    return Pieces(replace(camera, tracks=tuple(kept)), tuple(members))


def _filled(track: LiftedTrack, times: Float64Array) -> LiftedTrack:
    x = bridged(track.x, times, longest_s=LONGEST_BRIDGE_S)
    focal = bridged(track.focal[..., None], times, longest_s=LONGEST_BRIDGE_S)[..., 0]
    return replace(track, x=x, focal=focal)


def whole_tracks(camera: LiftedCamera) -> Pieces:
    """Return the tracks of a camera as they are."""
    parts = ((_part(p, track, camera.stamps),) for p, track in enumerate(camera.tracks))
    return Pieces(camera, tuple(parts))


def _part(p: int, track: LiftedTrack, stamps: Float64Array) -> TrackPart:
    return TrackPart(p, float(stamps[track.frames[0]]), float(stamps[track.frames[-1]]))


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
    return Pieces(camera, tuple(pieces.parts[k] for k in kept))


def _between_jumps(track: LiftedTrack, times: Float64Array) -> Iterator[LiftedTrack]:
    """Yield the stretches of a track in which no two successive frames are of two people."""
    if len(times) < MIN_LINK_FRAMES:
        return
    pixels = track.x * track.focal[..., None]
    moved = median_of_known(np.linalg.norm(np.diff(pixels, axis=0), axis=-1), otherwise=0.0)
    limit = JUMP_FACTOR * _usual_nearby(moved) + JUMP_FRACTION * height_px(track)
    jumps = (moved > limit) | (np.diff(times) > MAX_GAP_S)
    edges = [0, *(np.flatnonzero(jumps) + 1).tolist(), len(times)]
    for begin, end in pairwise(edges):
        if end - begin >= MIN_LINK_FRAMES:
            yield track[begin:end]


def _usual_nearby(moved: Float64Array) -> Float64Array:
    """Return the median (F,) of the values beside each, itself left out."""
    n = _NEIGHBOURS
    padded = np.pad(moved, n, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * n + 1)
    return np.asarray(np.median(np.delete(windows, n, axis=1), axis=1))


def _joined(parts: list[LiftedTrack]) -> LiftedTrack:
    """Return one track of successive ones."""
    if len(parts) == 1:
        return parts[0]
    rows = [np.asarray(part.rows) for part in parts if part.rows is not None]
    return LiftedTrack(
        parts[0].track_id,
        np.concatenate([part.frames for part in parts]),
        np.concatenate([part.x for part in parts]),
        np.concatenate([part.focal for part in parts]),
        np.concatenate([part.joints_cam for part in parts]),
        np.concatenate([part.root_cam for part in parts]),
        np.concatenate(rows) if rows else None,
    )


def _unmirrored(track: LiftedTrack, times: Float64Array, mirrored: IntArray) -> LiftedTrack:
    """Exchange left and right back where they were exchanged for a short time."""
    flipped = _flipped(track, times, mirrored)
    if not flipped.any():
        return track
    x, focal, joints = track.x.copy(), track.focal.copy(), track.joints_cam.copy()
    for values in (x, focal, joints):
        values[flipped] = values[flipped][:, mirrored]
    return replace(track, x=x, focal=focal, joints_cam=joints)


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
