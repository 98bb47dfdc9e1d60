"""The image points of associated persons, laid out for bundle adjustment.

World time is cut at uniform time bins. Every image of every camera belongs to the time bin nearest
to it by the present offsets, or to the one beside it that has none, where jitter put two images
next to one time bin; the rest, half a step or little more, is left to the motion model
``X + phi V`` (Section IV).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.lenses import Lenses, estimated_lenses
from stcalib_ros.core.bundle.limits import FURTHEST_BINS
from stcalib_ros.core.bundle.point_views import PointTimes
from stcalib_ros.core.integration.association import Association
from stcalib_ros.core.model.arrays import BoolArray, Float32Array, Float64Array, IntArray
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rig import Rig


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Image points by row (one person at one time bin), camera and joint.

    Attributes
    ----------
    person, time_bin : (N,) ndarray of int
        Rows are sorted by person, then time bin.
    track : (N, C) ndarray of int
        Index of the track that the points come from; -1 where none.
    phi : (N, C) ndarray
        Time of the image after the time bin by the offsets of the rig, seconds.
    x : (N, C, J, 2) ndarray
        Points on the plane z = 1; 0 where not seen.
    focal : (N, C, J) ndarray
        Pixels per unit of x.
    observed : (N, C, J) ndarray of bool
    start_s, step_s : float
        Time of time bin 0 and between time bins.
    row : (N, C, J) ndarray or None
        Of the points in their images, px, from the row that `phi` is the time of; 0 where not
        seen. None where all shutters take all rows at once.
    line_s : (C,) ndarray or None
        Line times of the shutters, seconds per row.
    middle_s : float
        Time at which clocks with a skew have the offsets of the rig.
    lenses : Lenses or None
        By which the points were undistorted; None where all are given.
    """

    person: IntArray
    time_bin: IntArray
    track: IntArray
    phi: Float64Array
    x: Float32Array
    focal: Float32Array
    observed: BoolArray
    start_s: float
    step_s: float
    row: Float32Array | None = None
    line_s: Float64Array | None = None
    middle_s: float = 0.0
    lenses: Lenses | None = None

    def rows_of(self, person: IntArray, time_bin: IntArray) -> IntArray:
        """Row of each person (...) at each time bin (...); -1 where there is none."""
        span = int(self.time_bin.max(initial=0)) + 1
        keys = self.person * span + self.time_bin
        inside = (time_bin >= 0) & (time_bin < span)
        wanted = np.where(inside, person * span + time_bin, -1)
        at = np.searchsorted(keys, wanted)
        found = keys[np.minimum(at, len(keys) - 1)] == wanted if len(keys) else inside & False
        return np.where(found, at, -1)

    def since_middle(self, rows: slice | IntArray = slice(None)) -> Float64Array:
        """Time (n,) of rows after the middle of the recording, s."""
        return np.asarray(self.start_s + self.time_bin[rows] * self.step_s - self.middle_s)

    def point_times(self, rows: slice | IntArray = slice(None)) -> PointTimes:
        """What the delays of the points of rows depend on: (n, 1, 1) and (n, C, J)."""
        row = np.zeros((1, 1, 1)) if self.row is None else self.row[rows]
        return PointTimes(self.since_middle(rows)[:, None, None], row)

    def elapsed(self, rows: slice | IntArray = slice(None)) -> Float64Array:
        """Time of the points after their time bins by the offsets of the rig, seconds.

        (n, C, J), or (n, C, 1) where all joints of an image are seen at once.
        """
        when = self.phi[rows][..., None]
        if self.row is None or self.line_s is None:
            return when
        return np.asarray(when + self.line_s[:, None] * self.row[rows])

    def thinned_joints(self, n: int) -> Observations:
        """The same with every n-th joint only; a copy, so that the others can be forgotten."""
        return replace(
            self,
            x=self.x[:, :, ::n].copy(),
            focal=self.focal[:, :, ::n].copy(),
            observed=self.observed[:, :, ::n].copy(),
            row=None if self.row is None else self.row[:, :, ::n].copy(),
        )

    def only(self, rows: IntArray | BoolArray) -> Observations:
        """The same with some rows only."""
        names = ("person", "time_bin", "track", "phi", "x", "focal", "observed")
        row = None if self.row is None else self.row[rows]
        return replace(self, row=row, **{name: getattr(self, name)[rows] for name in names})


def observe(
    cameras: Sequence[LiftedCamera], rig: Rig, association: Association, *, step_s: float
) -> Observations:
    """Collect the image points of all persons that at least two cameras see at a time bin."""
    members = [cameras[c] for c in rig.cameras]
    C = len(members)
    some = next(t for m in members for t in m.tracks)
    J, precision = some.x.shape[1], some.x.dtype
    n_bins = int(np.ceil(association.person_of[0].shape[1] * association.slot_s / step_s)) + 2
    table = [_images(m, rig, i, association, step_s) for i, m in enumerate(members)]
    cells, image_of = zip(*(_cells(images, n_bins) for images in table), strict=True)
    occupied, n_cameras = np.unique(np.concatenate(cells), return_counts=True)
    rows = occupied[n_cameras >= 2]
    N = len(rows)
    x, focal = np.zeros((N, C, J, 2), precision), np.ones((N, C, J), precision)
    seen = np.zeros((N, C, J), dtype=bool)
    phi, track = np.zeros((N, C)), np.full((N, C), -1, dtype=np.int64)
    rolling = some.rows is not None
    row = np.zeros((N, C, J), precision) if rolling else None
    for c, images in enumerate(table):
        _, there, here = np.intersect1d(rows, cells[c], assume_unique=True, return_indices=True)
        image = image_of[c][here]
        points = images.x[image]
        known = np.isfinite(points).all(-1)
        seen[there, c] = known
        x[there, c] = np.where(known[..., None], points, 0.0)
        focal[there, c] = np.where(known, images.focal[image], 1.0)
        phi[there, c], track[there, c] = images.phi[image], images.track[image]
        if row is not None and images.rows is not None:
            row[there, c] = np.where(known, images.rows[image], 0.0)
    person, time_bin = rows // n_bins, rows % n_bins
    middle = 0.5 * float(time_bin.min() + time_bin.max()) * step_s if N else 0.0
    return Observations(
        *(person, time_bin, track, phi, x, focal, seen),
        *(association.start_s, step_s, row),
        np.array([m.shutter.line_time_s for m in members]) if rolling else None,
        association.start_s + middle,
        estimated_lenses(members),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _CameraImages:
    person: IntArray
    time_bin: IntArray
    phi: Float64Array
    track: IntArray
    x: Float32Array
    focal: Float32Array
    rows: Float64Array | None = None


def _images(
    camera: LiftedCamera, rig: Rig, i: int, association: Association, step_s: float
) -> _CameraImages:
    """All images of associated persons of one camera, with the time bins they belong to."""
    parts = []
    times = camera.stamps + rig.offset_s[i]
    elapsed = times - association.start_s
    time_bins = nearest_bins(elapsed / step_s)
    late = elapsed - time_bins * step_s
    for p, track in enumerate(camera.tracks):
        person = association.person_of[i][p][association.slot(times[track.frames])]
        use = person >= 0
        frames = track.frames[use]
        index = np.full(len(frames), p, dtype=np.int64)
        part = (person[use], time_bins[frames], late[frames], index, track.x[use], track.focal[use])
        parts.append(part if track.rows is None else (*part, track.rows[use]))
    return _CameraImages(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _cells(images: _CameraImages, n_bins: int) -> tuple[IntArray, IntArray]:
    """Persons at time bins, as sorted numbers, and the image of each that is nearest in time."""
    nearest_first = np.argsort(-np.abs(images.phi), kind="stable")[::-1]
    cell = images.person * n_bins + images.time_bin
    occupied, first = np.unique(cell[nearest_first], return_index=True)
    return occupied, nearest_first[first]


def nearest_bins(position: Float64Array) -> IntArray:
    """Time bins of the images of a camera at increasing positions (F,), in steps.

    Of two images in one time bin, the earlier one moves to the time bin before if that has none and
    is less than three quarters of a step away, or else the later one to the time bin after.
    """
    time_bin: IntArray = np.rint(position).astype(np.int64)
    for first, way in ((0, -1), (1, 1)):
        movable = np.flatnonzero(time_bin[1:] == time_bin[:-1]) + first
        to = time_bin[movable] + way
        free = ~np.isin(to, time_bin) & (np.abs(position[movable] - to) < FURTHEST_BINS)
        time_bin[movable[free]] = to[free]
    return time_bin


def blocks_of(obs: Observations) -> Iterator[slice]:
    """Rows in portions that fit into the cache."""
    N, C, J = obs.observed.shape
    return row_blocks(N, C * J)


_BLOCK = 10_000
"""Count. Keypoints of a block, whose arrays fit into the cache of usual processors. Numerical."""


def row_blocks(n_rows: int, per_row: int) -> Iterator[slice]:
    """Slices of rows with about so many image points that a block fits into the cache."""
    size = max(1, _BLOCK // max(per_row, 1))
    for begin in range(0, n_rows, size):
        yield slice(begin, min(begin + size, n_rows))
