"""What is in a recording, camera by camera: counted, not judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.geometry.interpolation import frame_rate
from stcalib_ros.core.lifting.pose_axes import projection_correlation
from stcalib_ros.core.lifting.track_checks import continued_fraction
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.recording import CameraRecording
from stcalib_ros.core.options import Options

CELLS = 8
"""Count. Rows and columns into which an image is divided to say how much of it people cover.
Chosen: a cell of a full HD image is about a head wide at 3 m."""


@dataclass(frozen=True, slots=True)
class CameraFacts:
    """What one camera recorded.

    Attributes
    ----------
    name : str
    n_images, n_tracks : int
    rate_hz : float
        One over the usual time between images; 0 with fewer than two.
    longest_gap_s : float
        Longest time between two images; NaN with fewer than two.
    begin_s, end_s : float
        Stamps of the first and last image, seconds since the epoch of the recording.
    common_fraction : float
        Fraction of its images within the time of the other cameras, as their stamps say it, all
        of them together.
    layout : str
    persons : float
        Mean number of persons in an image.
    with_person : float
        Fraction of the images with a person.
    continued : float
        Fraction of poses that go on from the image before under the same id; NaN with few poses.
    coverage : float
        Fraction of the image, in cells of an eighth of each side, in which there is a keypoint.
    scored : float
        Fraction of keypoints that are known and have a score of `Options.min_score` or more.
    projection : float
        Correlation of keypoints with x and y of the 3D poses; NaN without 3D poses.
    size_px : (int, int)
        Width and height of the image that CameraInfo describes.
    lens : LensKnowledge
        What the intrinsics are worth.
    has_intrinsics : bool
        Whether the recording has intrinsics of this camera.
    """

    name: str
    n_images: int
    n_tracks: int
    rate_hz: float
    longest_gap_s: float
    begin_s: float
    end_s: float
    common_fraction: float
    layout: str
    persons: float
    with_person: float
    continued: float
    coverage: float
    scored: float
    projection: float
    size_px: tuple[int, int]
    lens: LensKnowledge
    has_intrinsics: bool


def facts_of(cameras: Sequence[CameraRecording], options: Options) -> tuple[CameraFacts, ...]:
    """Count what every camera recorded.

    Parameters
    ----------
    cameras : sequence of CameraRecording
        As they were recorded, each with one image or more.
    options : Options
        For `min_score` and the worth of intrinsics that do not say it themselves.
    """
    return tuple(
        _facts(camera, [o for o in cameras if o is not camera], options) for camera in cameras
    )


def _facts(
    camera: CameraRecording, others: Sequence[CameraRecording], options: Options
) -> CameraFacts:
    stamps = camera.stamps
    n_poses = sum(len(track.frames) for track in camera.tracks)
    seen = np.zeros(len(stamps), dtype=bool)
    for track in camera.tracks:
        seen[track.frames] = True
    used = [_used(camera, k, options.min_score) for k in range(len(camera.tracks))]
    n_points = sum(mask.size for mask in used)
    lens = camera.intrinsics
    return CameraFacts(
        name=camera.name,
        n_images=len(stamps),
        n_tracks=len(camera.tracks),
        rate_hz=frame_rate(stamps),
        longest_gap_s=float(np.diff(stamps).max()) if len(stamps) > 1 else float("nan"),
        begin_s=float(stamps[0]),
        end_s=float(stamps[-1]),
        common_fraction=_common_fraction(stamps, others),
        layout=camera.layout.name or f"{camera.layout.n_joints} joints",
        persons=n_poses / len(stamps),
        with_person=float(seen.mean()),
        continued=continued_fraction(camera),
        coverage=_coverage(camera, used),
        scored=sum(int(mask.sum()) for mask in used) / max(n_points, 1),
        projection=_projection(camera, options.min_score),
        size_px=(lens.width, lens.height),
        lens=camera.lens_knowledge or LensKnowledge(options.intrinsics),
        has_intrinsics=lens.known,
    )


def _projection(camera: CameraRecording, min_score: float) -> float:
    """Return the correlation of keypoints with 3D poses; NaN without a lens."""
    focal = camera.intrinsics.K[[0, 1], [0, 1]]
    if not (focal > 0.0).all():
        return float("nan")
    return projection_correlation(camera, min_score=min_score)


def _common_fraction(stamps: Float64Array, others: Sequence[CameraRecording]) -> float:
    """Return the fraction of images within the time that other cameras record, any of them."""
    within = np.zeros(len(stamps), dtype=bool)
    for other in others:
        within |= (stamps >= other.stamps[0]) & (stamps <= other.stamps[-1])
    return float(within.mean())


def _used(camera: CameraRecording, k: int, min_score: float) -> BoolArray:
    """Return which keypoints (F, J) of the k-th track are known and scored."""
    track = camera.tracks[k]
    return np.asarray(np.isfinite(track.keypoints).all(-1) & (track.scores >= min_score))


def _coverage(camera: CameraRecording, used: Sequence[BoolArray]) -> float:
    """Return the fraction of the cells of the image with a keypoint."""
    size = np.array([camera.intrinsics.width, camera.intrinsics.height], dtype=np.float64)
    covered = np.zeros((CELLS, CELLS), dtype=bool)
    for track, mask in zip(camera.tracks, used, strict=True):
        points = track.keypoints[mask]
        inside = points[((points >= 0.0) & (points < size)).all(-1)]
        column, row = (inside * (CELLS / size)).astype(np.int64).T
        covered[row, column] = True
    return float(covered.mean())
