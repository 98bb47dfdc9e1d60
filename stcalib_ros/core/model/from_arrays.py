"""Recordings from plain arrays: the poses that one camera detected, one per row."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.camera_info import intrinsics_from_camera_info
from stcalib_ros.core.model.keypoint_layouts import Layout, find_layout
from stcalib_ros.core.model.lens_knowledge import lens_knowledge
from stcalib_ros.core.model.recording import (
    CameraRecording,
    Intrinsics,
    LensModel,
    Track,
    unknown_joints,
)


def camera_from_arrays(
    name: str,
    *,
    K: ArrayLike | None,
    image_size: tuple[int, int],
    stamps: ArrayLike,
    frames: ArrayLike,
    track_ids: ArrayLike,
    keypoints: ArrayLike,
    joints: ArrayLike | None = None,
    scores: ArrayLike | None = None,
    layout: str | Layout = "coco_17",
    D: Sequence[float] = (),
    lens_model: LensModel = LensModel.PLUMB_BOB,
    metric: bool = False,
    line_time_s: float = 0.0,
    intrinsics: str | None = None,
    lens_group: str = "",
) -> CameraRecording:
    """Make the recording of one camera from arrays of detected poses, M in all.

    Parameters
    ----------
    name : str
        Name of the camera; its optical frame is ``<name>_optical_frame``.
    K : (3, 3) array_like or None
        Pinhole matrix, px; None: not known.
    image_size : (int, int)
        Width and height of the image, px.
    stamps : (N,) array_like
        Acquisition times of all images by the camera's own clock, seconds, strictly increasing;
        images without a person included.
    frames : (M,) array_like of int
        Index of the image in which each pose was detected, 0..N-1.
    track_ids : (M,) array_like of int
        Person of each pose according to this camera's own tracker; not shared between cameras.
    keypoints : (M, J, 2) array_like
        Image positions, px, not fractions of the image; NaN or (0, 0) where not detected.
    joints : (M, J, 3) array_like, optional
        Monocular 3D poses in the axes of the optical frame (x right, y down, z forward), metres
        or up to scale, with any origin; NaN where unknown. Default: there are none, and the
        keypoints are used alone.
    scores : (M, J) array_like, optional
        Confidence of each joint, 0..1. Default: 1 where a keypoint was detected, else 0.
    layout : str or Layout
        Layout of the J joints: the name of one of `LAYOUTS`, or a layout.
    D : sequence of float
        Distortion coefficients in OpenCV's order; empty: no distortion.
    lens_model : LensModel
        Model that `D` belongs to.
    metric : bool
        Whether the 3D poses are in metres.
    line_time_s : float
        Line delay of a rolling shutter, seconds per image row; 0: global shutter.
    intrinsics : str, optional
        What they are worth: "given", "refine" or "unknown". Default: as `Options` has it.
    lens_group : str
        Cameras of one group that is not empty have one lens.

    Returns
    -------
    CameraRecording
        With poses of float64; tracks in the order of their ids.

    Raises
    ------
    InputError
        An array has the wrong shape, a frame index has no stamp, a track has two poses in one
        image, or the lens or the layout cannot be used; the message names the camera.

    Examples
    --------
    >>> import numpy as np
    >>> import stcalib_ros as st
    >>> def arrays_of(camera):
    ...     tracks = camera.tracks
    ...     ids = np.repeat([t.track_id for t in tracks], [len(t.frames) for t in tracks])
    ...     rows = {"track_ids": ids, "K": camera.intrinsics.K, "stamps": camera.stamps}
    ...     for field in ("frames", "keypoints", "joints"):
    ...         rows[field] = np.concatenate([getattr(t, field) for t in tracks])
    ...     return rows
    >>> scene = st.simulate(st.SceneOptions(n_cameras=3, n_people=2, n_frames=180))
    >>> arrays = {camera.name: arrays_of(camera) for camera in scene.recording.cameras}

    These are the arrays that detector, lifter and tracker give for each camera. The calibration:

    >>> def calibrated(arrays):
    ...     size, layout = (1920, 1080), "h36m_17"
    ...     cameras = [
    ...         st.camera_from_arrays(name, image_size=size, layout=layout, **given)
    ...         for name, given in arrays.items()
    ...     ]
    ...     return st.calibrate(st.Recording(tuple(cameras)))
    >>> calibration = calibrated(arrays)
    >>> calibration.status.name
    'OK'
    >>> bool(st.evaluate(calibration, scene.truth).E_R < 0.02)  # rad
    True

    Without a lifter:

    >>> for given in arrays.values():
    ...     del given["joints"]
    >>> calibration = calibrated(arrays)
    >>> calibration.status.name
    'OK'
    >>> bool(st.evaluate(calibration, scene.truth).E_R < 0.02)
    True
    """
    try:
        known = find_layout(layout) if isinstance(layout, str) else layout
        times = _array("stamps", stamps, (None,))
        if not (np.isfinite(times).all() and (np.diff(times) > 0).all()):
            raise InputError("stamps must be finite and strictly increasing")
        tracks = _tracks(
            _integers("frames", frames, (None,)), track_ids, keypoints, joints, scores, known
        )
        _require_images(tracks, len(times))
        lens = _lens(K, image_size, D, lens_model)
        worth = None if intrinsics is None else lens_knowledge(intrinsics, "intrinsics")
    except InputError as error:
        raise InputError(f"camera {name}: {error}") from error
    return CameraRecording(
        *(name, f"{name}_optical_frame", lens, known, times, tracks),
        metric=metric,
        line_time_s=line_time_s,
        lens_knowledge=worth,
        lens_group=lens_group,
    )


def _tracks(
    frames: IntArray,
    track_ids: ArrayLike,
    keypoints: ArrayLike,
    joints: ArrayLike | None,
    scores: ArrayLike | None,
    layout: Layout,
) -> tuple[Track, ...]:
    M, J = len(frames), layout.n_joints
    ids = _integers("track_ids", track_ids, (M,))
    points = _array("keypoints", keypoints, (M, J, 2))
    poses = None if joints is None else _array("joints", joints, (M, J, 3))
    points[~points.any(axis=-1)] = np.nan
    detected = np.isfinite(points).all(axis=-1)
    given = _array("scores", detected if scores is None else scores, (M, J))
    tracks = []
    for track_id in np.unique(ids):
        rows = np.flatnonzero(ids == track_id)
        rows = rows[np.argsort(frames[rows], kind="stable")]
        own = points[rows]
        joints_cam = unknown_joints(own) if poses is None else poses[rows]
        tracks.append(Track(int(track_id), frames[rows], own, joints_cam, given[rows]))
    return tuple(tracks)


def _require_images(tracks: Sequence[Track], n_images: int) -> None:
    """Require that every pose has an image, and no track two poses in one."""
    for track in tracks:
        if track.frames[0] < 0 or track.frames[-1] >= n_images:
            raise InputError(
                f"frames must be indices into the {n_images} stamps, 0 to {n_images - 1}; "
                f"track {track.track_id} has {track.frames[0]} to {track.frames[-1]}"
            )
        repeated = track.frames[1:][np.diff(track.frames) == 0]
        if repeated.size:
            raise InputError(
                f"track {track.track_id} has two poses in image {repeated[0]}: "
                "give two people of one image two track ids"
            )


def _lens(
    K: ArrayLike | None, image_size: tuple[int, int], D: Sequence[float], model: LensModel
) -> Intrinsics:
    matrix = np.zeros((3, 3)) if K is None else _array("K", K, (3, 3))
    width, height = image_size
    return intrinsics_from_camera_info(
        width=width,
        height=height,
        distortion_model=model.value,
        d=D,
        k=matrix.ravel(),
        r=(),
        p=(),
        rectified=False,
    )


def _array(name: str, given: ArrayLike, shape: tuple[int | None, ...]) -> Float64Array:
    values = np.array(given, dtype=np.float64)
    _require_shape(name, values.shape, shape)
    return values


def _integers(name: str, given: ArrayLike, shape: tuple[int | None, ...]) -> IntArray:
    values = np.asarray(given)
    _require_shape(name, values.shape, shape)
    if values.size and values.dtype.kind not in "iu":
        raise InputError(f"{name}: expected whole numbers, got an array of {values.dtype}")
    return values.astype(np.int64)


def _require_shape(name: str, shape: tuple[int, ...], wanted: tuple[int | None, ...]) -> None:
    fits = len(shape) == len(wanted) and all(
        w is None or n == w for n, w in zip(shape, wanted, strict=True)
    )
    if not fits:
        text = ", ".join("any" if w is None else str(w) for w in wanted)
        raise InputError(f"{name}: expected shape ({text}), got {shape}")
