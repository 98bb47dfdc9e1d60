"""From the 2D poses of each camera to a `Recording`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS, Layout, find_layout
from stcalib_ros.core.model.recording import (
    CameraRecording,
    Intrinsics,
    Recording,
    Track,
    unknown_intrinsics,
    unknown_joints,
)
from stcalib_ros.io.convert_options import (
    ConvertOptions,
    require_cameras,
    require_rate,
    require_stamps,
)
from stcalib_ros.io.limits import MAX_COUNT, MAX_KEYPOINT_PX
from stcalib_ros.io.messages import NS
from stcalib_ros.io.plausible import require_size
from stcalib_ros.io.sources.form import UNTRACKED, CameraPoses, PoseSource, SourceOptions

_BY_COUNT = {
    17: "coco_17",
    18: "coco_18",
    25: "body_25",
    26: "halpe_26",
    33: "blazepose_33",
    133: "coco_wholebody_133",
    136: "halpe_26",
}
"""Layouts by the number of keypoints; the first 26 of Halpe's 136 are those of the body."""


MAX_OUTSIDE = 0.5
"""Fraction of a camera's keypoints that may be outside of its image; with more, the size is that of
other images. Chosen: estimators place hidden joints of people at the edge outside, never most."""


def recording_of_source(
    source: PoseSource, options: ConvertOptions, given: SourceOptions
) -> Recording:
    """Make the recording of a source.

    Poses that no tracker follows get ids of their own, a new one each: the calibration links them
    (`stcalib_ros.core.lifting.track_linking`).

    Parameters
    ----------
    source : PoseSource
    options : ConvertOptions
    given : SourceOptions

    Raises
    ------
    InputError
        Frame rate, layout or the size of an image is neither in the source nor given; stamps do
        not increase; or a number is none of an image.
    """
    names = [camera.name for camera in source.cameras]
    require_cameras(source.path, names, options)
    layout = _layout(source, options.layout)
    stamps = [_stamps_ns(source.path, camera, options) for camera in source.cameras]
    ends = [int(all_ns[k]) / NS for all_ns in stamps for k in (0, -1)]
    require_stamps(source.path, ends)
    epoch_ns = int(min(all_ns[0] for all_ns in stamps)) // NS * NS
    lenses = [_lens(source.path, camera, given) for camera in source.cameras]
    cameras = tuple(
        CameraRecording(
            name=camera.name,
            frame_id=f"{camera.name}_optical_frame",
            intrinsics=lens,
            layout=layout,
            stamps=(all_ns - epoch_ns) / NS,
            tracks=_tracks(source, camera, layout, lens),
        )
        for camera, all_ns, lens in zip(source.cameras, stamps, lenses, strict=True)
    )
    return Recording(cameras, epoch_ns)


def _layout(source: PoseSource, wanted: str | None) -> Layout:
    counts = sorted({len(pose.points) for camera in source.cameras for pose in camera.poses})
    if not counts:
        raise InputError(f"{source.path} has no poses")
    if len(counts) > 1:
        raise InputError(
            f"{source.path} has poses of {' and of '.join(map(str, counts))} keypoints: run one "
            "model on all cameras"
        )
    (count,) = counts
    name = wanted or source.layout or _BY_COUNT.get(count, "")
    if not name:
        raise InputError(
            f"{source.path} has poses of {count} keypoints, but does not say of which joints: "
            f"give --layout, one of {', '.join(LAYOUTS)}"
        )
    layout = find_layout(name)
    if count < layout.n_joints or (count > layout.n_joints and wanted):
        raise InputError(
            f"layout {name!r} has {layout.n_joints} joints, the poses of {source.path} {count}"
        )
    return layout


def _stamps_ns(path: Path, camera: CameraPoses, options: ConvertOptions) -> IntArray:
    shift_ns = round(options.clock_shifts_s.get(camera.name, 0.0) * NS)
    if camera.stamps_ns is not None:
        stamps = camera.stamps_ns
        if len(back := np.flatnonzero(np.diff(stamps) <= 0)):
            image = camera.images[back[0] + 1]
            raise InputError(
                f"{path}: timestamps of {camera.name} do not increase: image {image} is at "
                f"{stamps[back[0] + 1] / NS:.6f} s, the one before at {stamps[back[0]] / NS:.6f} s"
            )
        start_ns = options.start_s * NS if stamps[0] < NS * NS else 0
        return np.asarray(stamps + start_ns + shift_ns)
    fps = camera.fps if options.fps is None else options.fps
    if fps is None:
        raise InputError(
            f"{path} does not say the frame rate: give --fps HZ, or the time "
            "of each image with --stamps FILE.csv"
        )
    since_ns = np.round(camera.images * (NS / require_rate(path, fps))).astype(np.int64)
    return np.asarray(options.start_s * NS + since_ns + shift_ns)


def _lens(path: Path, camera: CameraPoses, given: SourceOptions) -> Intrinsics:
    lens = given.lenses.get(camera.name, camera.lens)
    if lens is None and camera.no_lens:
        raise InputError(f"{camera.no_lens}; give the lenses with --intrinsics FILE")
    size = given.image_size or camera.size or ((lens.width, lens.height) if lens else None)
    if size is None:
        raise InputError(
            f"{path} does not say how large the images of {camera.name} are: give --image-size "
            "WIDTHxHEIGHT"
        )
    size = require_size(size, f"{path}: images of {camera.name}")
    if lens is None:
        return unknown_intrinsics(*size)
    if (lens.width, lens.height) != size:
        raise InputError(
            f"{path}: the lens of {camera.name} is for images of {lens.width} x {lens.height} px, "
            f"but its images have {size[0]} x {size[1]}"
        )
    return lens


def _tracks(
    source: PoseSource, camera: CameraPoses, layout: Layout, lens: Intrinsics
) -> tuple[Track, ...]:
    if not camera.poses:
        return ()
    points = np.stack([pose.points[: layout.n_joints] for pose in camera.poses])
    if source.normalised:
        points[..., :2] *= (lens.width, lens.height)
    known = np.isfinite(points).all(-1) & (points[..., :2] != 0).any(-1)
    furthest = float(np.abs(points[known][:, :2]).max(initial=0.0))
    if 0 < furthest <= 1 and not source.normalised:
        raise InputError(
            f"{source.path}: all keypoints of {camera.name} are within 1 px of the corner of the "
            "image, as if they were fractions of it: write them in pixels"
        )
    outside = ((points[known][:, :2] < 0) | (points[known][:, :2] > (lens.width, lens.height))).any(
        1
    )
    if len(outside) and outside.mean() > MAX_OUTSIDE:
        raise InputError(
            f"{source.path}: {outside.mean():.0%} of the keypoints of {camera.name} are outside of "
            f"its image of {lens.width} x {lens.height} px, up to {furthest:.0f} px: with "
            "--image-size, give the size of the images in which they were detected"
        )
    if furthest > MAX_KEYPOINT_PX:
        raise InputError(
            f"{source.path}: a keypoint of {camera.name} is {furthest:.6g} px from the corner of "
            f"the image, more than {MAX_KEYPOINT_PX:g}"
        )
    frames = np.searchsorted(camera.images, [pose.image for pose in camera.poses])
    ids = _ids(frames, [pose.track for pose in camera.poses])
    rows = np.flatnonzero(known.any(1))
    rows = rows[np.lexsort((frames[rows], ids[rows]))]
    parts = np.split(rows, np.flatnonzero(np.diff(ids[rows])) + 1) if len(rows) else []
    return tuple(
        _track(int(ids[part[0]]), frames[part], points[part], known[part]) for part in parts
    )


def _ids(frames: IntArray, tracks: Sequence[int]) -> IntArray:
    """Return the ids; those of nobody, and of a second pose in an image, become new ones."""
    ids = np.array(tracks, dtype=np.int64)
    first_of_id = np.unique(np.c_[frames, ids], axis=0, return_index=True)[1]
    nobody = np.union1d(
        np.flatnonzero(ids == UNTRACKED), np.setdiff1d(np.arange(len(ids)), first_of_id)
    )
    first = int(ids.max()) + 1
    if first + len(nobody) > MAX_COUNT:
        ids, first = np.unique(ids, return_inverse=True)[1].ravel(), len(np.unique(ids))
    ids[nobody] = first + np.arange(len(nobody))
    return ids


def _track(i: int, frames: IntArray, points: Float64Array, known: BoolArray) -> Track:
    keypoints = np.where(known[..., None], points[..., :2], np.nan)
    scores = np.where(known, np.clip(points[..., 2], 0.0, 1.0), 0.0)
    return Track(i, frames, keypoints, unknown_joints(keypoints), scores)
