"""Multi-view ``.npz`` files with detected poses, made into recordings."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.calibration import (
    Calibration,
    CameraCalibration,
    PersonAssociation,
    Status,
)
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
from stcalib_ros.io.lens_model import opencv_intrinsics
from stcalib_ros.io.messages import NS
from stcalib_ros.io.multi_view_arrays import Arrays, checked_arrays
from stcalib_ros.io.npz_files import read_npz
from stcalib_ros.io.plausible import require_lens, require_size


class Converted(NamedTuple):
    """A recording and its true values."""

    recording: Recording
    truth: Calibration


def convert_npz(path: Path | str, options: ConvertOptions | None = None) -> Converted:
    """Make recording and truth of a multi-view ``.npz`` file.

    Needed are the arrays ``camera_names, image_size``, ``fps``, ``frame_number``, and for each
    detection ``det_frame, det_camera`` and ``det_kp2d`` (x, y, score; 0, 0, 0: not detected) with
    the joint names ``kp_names``. ``K`` and ``dist`` are the lenses; without them these are not
    known. ``det_track`` are the ids of each camera's own tracker; without them nobody is tracked.
    ``R, t`` (``x_cam = R x_world + t``) and ``det_person`` (-1: unknown) are the truth. With
    ``det_kp3d`` (monocular poses in metres, camera axes; NaN: unknown) go their joint names,
    ``kp3d_names``.

    Every camera has an image at every frame; no frame is cut. The reference is the first camera.

    Raises
    ------
    InputError
        The file cannot be read or lacks an array, the truth included, or an option does not fit it.
    """
    path = Path(path)
    return convert_arrays(path, read_npz(path), options)


def has_truth(arrays: Arrays) -> bool:
    """Whether the true poses of the cameras are there."""
    return "R" in arrays or "t" in arrays


def convert_arrays(path: Path, arrays: Arrays, options: ConvertOptions | None = None) -> Converted:
    """Make recording and truth of the arrays of a multi-view file, wherever they come from.

    Parameters
    ----------
    path : Path
        The source, for messages.
    arrays : mapping of str to ndarray
        As in `convert_npz`; the 3D poses are in metres unless ``metric`` is there and false.
    options : ConvertOptions, optional

    Raises
    ------
    InputError
        An array has another shape than the others ask for, or an option does not fit.
    """
    options = options or ConvertOptions()
    if not has_truth(arrays):
        raise InputError(f"{path} has no true poses of its cameras: it lacks R and t")
    recording = recording_of_arrays(path, arrays, options)
    shifts = [options.clock_shifts_s.get(camera.name, 0.0) for camera in recording.cameras]
    return Converted(recording, _truth(path, checked_arrays(path, arrays), recording, shifts))


def recording_of_arrays(path: Path, arrays: Arrays, options: ConvertOptions) -> Recording:
    """Make the recording alone; parameters and errors are those of `convert_arrays`.

    Raises
    ------
    InputError
        As of `convert_arrays`; but the truth may be missing.
    """
    arrays = checked_arrays(path, arrays)
    names = [str(n) for n in arrays["camera_names"]]
    require_cameras(path, names, options)
    layout = _layout(path, arrays, options.layout)
    fps = require_rate(path, float(arrays["fps"]) if options.fps is None else options.fps)
    shifts = [options.clock_shifts_s.get(name, 0.0) for name in names]
    lenses = [_lens(path, arrays, c) for c in range(len(names))]
    frames = arrays["frame_number"] - arrays["frame_number"][0]
    length_s = frames[-1] / fps
    require_stamps(path, [options.start_s + s + t for s in shifts for t in (0.0, length_s)])
    true_ns = np.round(frames * (NS / fps)).astype(np.int64)
    first_ns = options.start_s * NS + min(round(s * NS) for s in shifts)
    epoch_ns = first_ns // NS * NS
    start_ns = options.start_s * NS - epoch_ns
    cameras = tuple(
        CameraRecording(
            name=name,
            frame_id=f"{name}_optical_frame",
            intrinsics=lenses[c],
            layout=layout,
            stamps=(start_ns + true_ns + round(shifts[c] * NS)) / NS,
            tracks=_tracks(arrays, c),
            metric="det_kp3d" in arrays and bool(arrays.get("metric", True)),
        )
        for c, name in enumerate(names)
    )
    return Recording(cameras, epoch_ns)


def _lens(path: Path, arrays: Arrays, c: int) -> Intrinsics:
    what = f"{path}: camera {arrays['camera_names'][c]}"
    if "K" not in arrays:
        width, height = require_size(arrays["image_size"][c], what)
        return unknown_intrinsics(width, height)
    lens = opencv_intrinsics(*(arrays[key][c] for key in ("image_size", "K", "dist")))
    return require_lens(lens, what)


def _layout(path: Path, arrays: Arrays, wanted: str | None) -> Layout:
    names = tuple(str(n) for n in arrays["kp_names"])
    names_3d = tuple(str(n) for n in arrays.get("kp3d_names", arrays["kp_names"]))
    if names != names_3d:
        raise InputError(f"{path}: 2D and 3D poses have different joints (kp_names, kp3d_names)")
    if wanted is not None:
        layout = find_layout(wanted)
        if layout.n_joints != len(names):
            raise InputError(
                f"layout {wanted!r} has {layout.n_joints} joints, but the poses of {path} have "
                f"{len(names)}"
            )
        return layout
    named = [known for known in LAYOUTS.values() if known.joint_names == names]
    return named[0] if named else find_layout("", names)


def _tracks(arrays: Arrays, camera: int) -> tuple[Track, ...]:
    rows = np.flatnonzero(arrays["det_camera"] == camera)
    ids: IntArray = arrays["det_track"][rows].astype(np.int64)
    return tuple(_track(arrays, int(i), rows[ids == i]) for i in np.unique(ids))


def _track(arrays: Arrays, track_id: int, rows: IntArray) -> Track:
    frames, first = np.unique(arrays["det_frame"][rows].astype(np.int64), return_index=True)
    points = arrays["det_kp2d"][rows[first]].astype(np.float64)
    seen = np.isfinite(points).all(axis=-1, keepdims=True) & points.any(axis=-1, keepdims=True)
    keypoints = np.where(seen, points[..., :2], np.nan)
    joints = unknown_joints(keypoints)
    if "det_kp3d" in arrays:
        joints = arrays["det_kp3d"][rows[first]].astype(np.float64)
        joints = np.where(np.isfinite(joints).all(axis=-1, keepdims=True), joints, np.nan)
    return Track(
        track_id=track_id,
        frames=frames,
        keypoints=keypoints,
        joints=joints,
        scores=np.where(seen, points[..., 2:], 0.0)[..., 0],
    )


def _truth(path: Path, arrays: Arrays, recording: Recording, shifts: list[float]) -> Calibration:
    stamps = recording.cameras[0].stamps + recording.epoch_ns / NS
    return Calibration(
        status=Status.OK,
        message=f"Reference values of {path.name}; no estimate.",
        reference=recording.cameras[0].name,
        metric=True,
        epoch_s=float(stamps[0]),
        window_s=(float(stamps[0]), float(stamps[-1])),
        cameras=tuple(
            _true_camera(arrays, c, camera, shifts[0] - shifts[c])
            for c, camera in enumerate(recording.cameras)
        ),
        uncalibrated=(),
        persons=_true_persons(arrays, recording),
        pairs=(),
        reprojection_rms_px=math.nan,
        n_observations=0,
        n_inliers=0,
    )


def _true_camera(
    arrays: Arrays, c: int, camera: CameraRecording, offset_s: float
) -> CameraCalibration:
    R_cam_world: Float64Array = np.asarray(arrays["R"], dtype=np.float64)
    t_cam_world: Float64Array = np.asarray(arrays["t"], dtype=np.float64)
    R_ref_cam = R_cam_world[0] @ R_cam_world[c].T if c else np.eye(3)
    return CameraCalibration(
        name=camera.name,
        frame_id=camera.frame_id,
        intrinsics=camera.intrinsics,
        R_ref_cam=R_ref_cam,
        t_ref_cam=t_cam_world[0] - R_ref_cam @ t_cam_world[c],
        covariance=np.zeros((6, 6)),
        time_offset_s=round(offset_s, 9),
        time_offset_stddev_s=0.0,
    )


def _true_persons(arrays: Arrays, recording: Recording) -> tuple[PersonAssociation, ...]:
    """Persons by their number in the source; a track is whose it is most of the time."""
    votes: dict[tuple[int, int], Counter[int]] = {}
    columns = (arrays[name].tolist() for name in ("det_camera", "det_track", "det_person"))
    for camera, track, person in zip(*columns, strict=True):
        votes.setdefault((camera, track), Counter())[person] += 1
    tracks: dict[int, dict[str, list[int]]] = {}
    for (camera, track), counts in sorted(votes.items()):
        person = counts.most_common(1)[0][0]
        if person >= 0:
            of_person = tracks.setdefault(person, {})
            of_person.setdefault(recording.cameras[camera].name, []).append(track)
    return tuple(
        PersonAssociation(
            person_id=person,
            tracks={name: tuple(ids) for name, ids in tracks[person].items()},
            reprojection_rms_px=math.nan,
        )
        for person in sorted(tracks)
    )
