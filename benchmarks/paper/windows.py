"""A pair of cameras on given windows of frames: the paper's protocol, for either method.

The paper's method compares whole frames, and offsets of the protocol are whole frames: its errors
of them are zero or whole frames. The refinement of the default method knows nothing of that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.integration.averaging import reliability
from stcalib_ros.core.lifting.views import LiftedViews
from stcalib_ros.core.model.arrays import BoolArray, IntArray
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.options import Options
from stcalib_ros.core.paper.oriented import oriented_points
from stcalib_ros.core.paper.registration import PairRegistration
from stcalib_ros.core.paper.registration import register as register_vmf
from stcalib_ros.core.registration.epipolar_correlation import keypoint_moments
from stcalib_ros.core.registration.pairs import PairTask, register
from stcalib_ros.core.registration.pieces import whole_tracks
from stcalib_ros.core.registration.resampling import Grid, common_step

_ALL_POINTS = 1_000_000
"""Keypoints. A pair is refined on all that it has: no adjustment follows, which would use them."""


def register_on_windows(
    views: LiftedViews,
    a: int,
    b: int,
    starts: Sequence[int] | IntArray,
    options: Options,
    *,
    max_lag: int,
    rng: np.random.Generator,
) -> PairRegistration | None:
    """Register two cameras on windows of ``options.vmf.window`` frames of the first.

    All windows together give one rotation, one offset and one translation.

    Parameters
    ----------
    views : Views
    a, b : int
        Indices of the cameras; a is the target view.
    starts : (W,) sequence of int
        First frames of the windows, counted from the first image of camera a in frame periods.
    options : Options
        ``registration.method`` says how. A track needs to be seen in a window only: the default
        method's ``min_overlap`` is lowered to the frames of all windows.
    max_lag : int
        Frame k of a is compared with the frames k - max_lag .. k + max_lag of b, counted from the
        same stamp; 0: synchronised.
    rng : numpy.random.Generator
        Generator for the paper's initial rotations; the default method needs none.

    Returns
    -------
    PairRegistration or None
        None if no person can be matched.

    Raises
    ------
    InputError
        There is no window, or one lies outside of the images of camera a.
    """
    cam_a, window = views.lifted[a], options.vmf.window
    step = common_step([views.lifted[a], views.lifted[b]])
    n = round(float(cam_a.stamps[-1] - cam_a.stamps[0]) / step) + 1
    first = np.asarray(starts, dtype=np.int64)
    if not len(first) or first.min() < 0 or first.max() + window > n:
        raise InputError(
            f"windows of {window} frames from {list(starts)}: {cam_a.name} has {n} frames"
        )
    begin = float(cam_a.stamps[0]) - max_lag * step
    size = n + 2 * max_lag
    if options.registration.method == "vmf":
        target, source = (
            oriented_points(views.lifted[c], views.skeleton, start=begin, step=step, n=size)
            for c in (a, b)
        )
        lags = np.arange(-max_lag, max_lag + 1)
        found = register_vmf(a, b, target, source, first + max_lag, lags, options.vmf, rng)
        return None if found is None else replace(found, starts=first)
    inside = _only_windows(cam_a, first, window, step)
    return _by_correlation(
        views, a, b, inside, first, options, begin=begin, n=size, max_lag=max_lag
    )


def _only_windows(camera: LiftedCamera, starts: IntArray, window: int, step: float) -> LiftedCamera:
    """Camera without the parts of its tracks outside the windows."""
    frame = np.rint((camera.stamps - camera.stamps[0]) / step).astype(np.int64)
    inside = np.isin(frame, (starts[:, None] + np.arange(window)).ravel())
    return replace(camera, tracks=tuple(_seen(t, inside[t.frames]) for t in camera.tracks))


def _seen(track: LiftedTrack, rows: BoolArray) -> LiftedTrack:
    """Some frames of a track; of a track that has none of them, one frame with nothing in it."""
    if not rows.any():
        nothing = (
            np.full_like(one[:1], np.nan)
            for one in (track.x, track.focal, track.joints_cam, track.root_cam)
        )
        return LiftedTrack(track.track_id, track.frames[:1], *nothing)
    return track[rows]


def _by_correlation(
    views: LiftedViews,
    a: int,
    b: int,
    target: LiftedCamera,
    starts: IntArray,
    options: Options,
    *,
    begin: float,
    n: int,
    max_lag: int,
) -> PairRegistration | None:
    """The default method on the windows of the target."""
    window, o = options.vmf.window, options.registration
    step = common_step([views.lifted[a], views.lifted[b]])
    grid = Grid(begin, step, n)
    pieces = (whole_tracks(target), whole_tracks(views.lifted[b]))
    task = PairTask(
        a,
        b,
        pieces,
        (keypoint_moments(pieces[0].camera, grid), keypoint_moments(pieces[1].camera, grid)),
        step,
        max_lag,
        replace(o, min_overlap=min(o.min_overlap, window * len(starts))),
        max_lag == 0,
        max_points=_ALL_POINTS,
    )
    hypotheses = register(task)
    if not hypotheses:
        return None
    best = max(hypotheses, key=reliability)
    return PairRegistration(best, starts, _in_windows(target, best, starts, window, step), np.nan)


def _in_windows(
    target: LiftedCamera, h: RelativePose, starts: IntArray, window: int, step: float
) -> IntArray:
    """Matches (M, 3) of whole tracks, in every window in which the target is seen."""
    found = []
    for p, q in h.matches:
        track = target.tracks[p]
        stamps = target.stamps[track.frames[np.isfinite(track.x).any((1, 2))]]
        frame = np.rint((stamps - target.stamps[0]) / step).astype(np.int64)
        for w, start in enumerate(starts):
            if ((frame >= start) & (frame < start + window)).any():
                found.append((w, p, q))
    return np.array(sorted(found), dtype=np.int64).reshape(-1, 3)
