"""Keypoints of the same persons at the same times in two cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.geometry.interpolation import Interpolation, frame_period
from stcalib_ros.core.geometry.robust import RMS_OVER_MEDIAN
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack
from stcalib_ros.core.model.relative_pose import RelativePose

MAX_POINTS = 800
"""Keypoints of a pair that are compared, about. Numerical: bounds the cost."""
_MAX_NOISE_FRAMES = 100
"""Frames of a track by which noise is measured, at most. Numerical: bounds the cost."""


@dataclass(frozen=True, slots=True, eq=False)
class Correspondences:
    """Keypoints of matched tracks at one lag.

    Attributes
    ----------
    x_a, x_b : (M, 3) ndarray
        Homogeneous points on the planes z = 1.
    v_b : (M, 3) ndarray
        Time derivative of `x_b`, per second.
    variance_b : (M,) ndarray
        Variance of `x_b` over that of one keypoint, if the noise of every image is its own:
        between two images it is less.
    variance_rate_b : (M,) ndarray
        Time derivative of that, per second.
    focal : (M,) ndarray
        Pixels per unit of x, geometric mean of both cameras.
    depth_a, depth_b : (M,) ndarray
        Depth of the body by its monocular pose or by its size, m; NaN where unknown.
    """

    x_a: Float64Array
    x_b: Float64Array
    v_b: Float64Array
    variance_b: Float64Array
    variance_rate_b: Float64Array
    focal: Float64Array
    depth_a: Float64Array
    depth_b: Float64Array


def correspondences(
    cameras: Sequence[LiftedCamera], h: RelativePose, *, max_points: int = MAX_POINTS
) -> Correspondences:
    """Matched keypoints at the lag of a hypothesis, thinned to about `max_points`."""
    return MatchedTracks(cameras[h.a], cameras[h.b], h.matches, max_points).at(h.lag_s)


def white_noise_px(tracks: Sequence[LiftedTrack]) -> float:
    """Standard deviation (px, per axis) of the noise of keypoints that is new in every image.

    It is measured on third differences, which hardly contain the motion of a body.
    """
    differences = [np.zeros(0)]
    for track in tracks:
        rows = slice(None, _MAX_NOISE_FRAMES)
        pixels = track.x[rows] * track.focal[rows, :, None]
        following = np.flatnonzero(np.diff(track.frames[rows], n=1) == 1)
        runs = following[np.isin(following + 1, following) & np.isin(following + 2, following)]
        third = pixels[runs + 3] - 3.0 * pixels[runs + 2] + 3.0 * pixels[runs + 1] - pixels[runs]
        differences.append(np.abs(third[np.isfinite(third)]))
    every = np.concatenate(differences)
    return float(RMS_OVER_MEDIAN * np.median(every) / np.sqrt(20.0)) if len(every) else 0.0


class MatchedTracks:
    """Matched tracks of two cameras, for their keypoints to be read off at any lag."""

    def __init__(
        self,
        cam_a: LiftedCamera,
        cam_b: LiftedCamera,
        matches: Sequence[tuple[int, int]],
        max_points: int,
    ) -> None:
        total = sum(cam_a.tracks[p].x.shape[0] * cam_a.tracks[p].x.shape[1] for p, _ in matches)
        self.stride = max(1, -(-total // max_points))
        self.tracks_a = [cam_a.tracks[p] for p, _ in matches]
        self.tracks_b = [cam_b.tracks[q] for _, q in matches]
        self.stamps_b = [cam_b.stamps[b.frames] for b in self.tracks_b]
        self.rows = [np.arange(0, len(a.frames), self.stride) for a in self.tracks_a]
        of_a = list(zip(self.tracks_a, self.rows, strict=True))
        self.times = [cam_a.stamps[a.frames[rows]] for a, rows in of_a]
        self.period = frame_period(cam_b.stamps)
        self.x_a = np.concatenate([a.x[rows] for a, rows in of_a])
        self.focal_a = np.concatenate([a.focal[rows] for a, rows in of_a])
        self.depth_a = np.concatenate([a.root_cam[rows, 2] for a, rows in of_a])
        self.known_a = np.isfinite(self.x_a).all(-1)
        self.white_px = white_noise_px(self.tracks_b)

    def at(self, lag_s: float) -> Correspondences:
        """Return the keypoints of the same time if ``t_b - t_a`` is `lag_s`."""
        between = self._interpolations(lag_s)
        pieces = list(zip(between, self.tracks_b, strict=True))
        x_b, v_b = (np.concatenate(c) for c in zip(*(i.both(b.x) for i, b in pieces), strict=True))
        focal_b = np.concatenate([i(b.focal) for i, b in pieces])
        depth_b = np.concatenate([i(b.root_cam[:, 2]) for i, b in pieces])
        variance, rate = (
            np.concatenate(c) for c in zip(*(i.variance for i in between), strict=True)
        )
        good = np.flatnonzero(self.known_a & np.isfinite(x_b).all(-1))
        x_a, x_b, v_b = (one.reshape(-1, 2)[good] for one in (self.x_a, x_b, v_b))
        focal = np.sqrt(self.focal_a.ravel()[good] * focal_b.ravel()[good])
        frame = good // self.known_a.shape[1]
        one, zero = np.ones((len(good), 1)), np.zeros((len(good), 1))
        return Correspondences(
            np.hstack([x_a, one]),
            np.hstack([x_b, one]),
            np.hstack([v_b, zero]),
            variance[frame],
            rate[frame],
            focal,
            self.depth_a[frame],
            depth_b[frame],
        )

    def _interpolations(self, lag_s: float) -> list[Interpolation]:
        return [
            Interpolation(stamps, times + lag_s, period=self.period)
            for stamps, times in zip(self.stamps_b, self.times, strict=True)
        ]
