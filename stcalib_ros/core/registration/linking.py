"""Pieces of tracks that one person goes on from one to the next, in one camera.

Trackers lose people and find them again under another id. Where a piece ends, and another one
begins at once where the first would have gone on, both are of one person.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array, FloatArray
from stcalib_ros.core.model.lifted import LiftedTrack
from stcalib_ros.core.registration.limits import (
    JUMP_FRACTION,
    LINK_GAP_S,
    LINK_SPEED,
    MIN_LINK_JOINTS,
)

_FIT_FRAMES = 4
"""Frames by which the motion at an end of a piece is known. Numerical: a tenth of a second."""


def chains(pieces: Sequence[LiftedTrack], stamps: Float64Array) -> list[list[int]]:
    """Return the pieces of each person, in the order of time.

    The nearest ends are linked first; each end is linked once.

    Parameters
    ----------
    pieces : sequence of LiftedTrack
    stamps : (N,) ndarray
        Times of the images of their camera, seconds.
    """
    following: dict[int, int] = {}
    begun = set()
    for _, k, n in sorted(_links(pieces, stamps)):
        if k not in following and n not in begun:
            following[k] = n
            begun.add(n)
    found = []
    for k in range(len(pieces)):
        if k not in begun:
            chain = [k]
            while chain[-1] in following:
                chain.append(following[chain[-1]])
            found.append(chain)
    return found


def _links(pieces: Sequence[LiftedTrack], stamps: Float64Array) -> list[tuple[float, int, int]]:
    """Distances, in body heights, of the ends and begins that may be one person's."""
    begins = np.array([stamps[p.frames[0]] for p in pieces])
    ends = np.array([stamps[p.frames[-1]] for p in pieces])
    gap = begins - ends[:, None]
    found = []
    for k, n in np.argwhere((gap > 0.0) & (gap <= LINK_GAP_S)):
        distance = _distance(pieces[k], pieces[n], stamps)
        if distance < JUMP_FRACTION + LINK_SPEED * gap[k, n]:
            found.append((distance, int(k), int(n)))
    return found


def _distance(one: LiftedTrack, other: LiftedTrack, stamps: Float64Array) -> float:
    """Median distance of joints from where they would have gone, over the height of the body."""
    last, first = one.frames[-1], other.frames[0]
    moved = _velocity(one, stamps) * (stamps[first] - stamps[last])
    gaps = other.x[0] - one.x[-1] - moved
    known = np.isfinite(gaps[..., 0])
    if known.sum() < MIN_LINK_JOINTS:
        return float("inf")
    size = max(height_px(one), height_px(other))
    focal = float(np.nanmedian(one.focal[-1]))
    return float(np.median(np.linalg.norm(gaps[known], axis=-1)) * focal / max(size, 1.0))


def _velocity(track: LiftedTrack, stamps: Float64Array) -> FloatArray:
    """Velocity (2,) of the middle of the joints over the last frames, per second."""
    x, times = track.x[-_FIT_FRAMES:], stamps[track.frames[-_FIT_FRAMES:]]
    both = np.isfinite(x[0, :, 0]) & np.isfinite(x[-1, :, 0])
    if not both.any() or len(x) < 2:
        return np.zeros(2)
    return np.asarray(np.median((x[-1] - x[0])[both], axis=0) / (times[-1] - times[0]))


def height_px(track: LiftedTrack) -> float:
    """Return the usual height of a body in the image, px; zero where nothing is seen."""
    y = track.x[..., 1] * track.focal
    seen = np.isfinite(y).any(1)
    if not seen.any():
        return 0.0
    return float(np.median(np.nanmax(y[seen], 1) - np.nanmin(y[seen], 1)))
