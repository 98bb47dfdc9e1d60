"""The input of a calibration: recordings of people by several cameras.

Frames are in the names: ``R_ref_cam`` turns coordinates of the camera's optical frame
(x right, y down, z forward) into those of the reference frame. Times are float64 seconds.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from stcalib_ros.core.model.arrays import BoolArray, Float64Array, FloatArray, IntArray
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.core.model.lens_knowledge import LensKnowledge, LensPrior


class LensModel(Enum):
    """Lens models of ``sensor_msgs/CameraInfo.distortion_model``."""

    PLUMB_BOB = "plumb_bob"
    RATIONAL_POLYNOMIAL = "rational_polynomial"
    EQUIDISTANT = "equidistant"


@dataclass(frozen=True, slots=True, eq=False)
class Intrinsics:
    """Lens of one camera, for the pixels that its keypoints are given in.

    Attributes
    ----------
    width, height : int
        Size of the image in px (after binning and region of interest).
    model : LensModel
        How `D` is to be read.
    K : (3, 3) ndarray
        Pinhole matrix, px; NaN where only the size of the image is known.
    D : (n,) ndarray
        Distortion coefficients in OpenCV's order; empty or zero: none.
    R_rect_cam : (3, 3) ndarray
        Optical frame to the frame in which `K` holds; not the identity only for rectified
        keypoints of a stereo pair.
    sensor : (float, float, float, float), optional
        Left, top, width and height of the whole sensor in pixels of the image, if the image is a
        region of interest. Default: the image is all of it.
    """

    width: int
    height: int
    model: LensModel
    K: Float64Array
    D: Float64Array
    R_rect_cam: Float64Array = field(default_factory=lambda: np.eye(3))
    sensor: tuple[float, float, float, float] | None = None

    @property
    def known(self) -> bool:
        """Whether more than the size of the image is known."""
        return bool(np.isfinite(self.K).all())


def unknown_intrinsics(width: int, height: int) -> Intrinsics:
    """Return the lens of a camera of which only the size of the image is known, px."""
    nothing = np.full((3, 3), np.nan)
    return Intrinsics(width, height, LensModel.PLUMB_BOB, nothing, np.zeros(0))


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One person as one camera's own tracker reports them: with gaps, fragments and id switches.

    Poses are float64, or the float32 of messages, which takes half of the memory.

    Attributes
    ----------
    track_id : int
        Id by this camera's own tracker; ids of different cameras are unrelated.
    frames : (F,) ndarray of int
        Strictly increasing indices into the stamps of the camera.
    keypoints : (F, J, 2) ndarray
        Image positions, px; NaN where not observed.
    joints : (F, J, 3) ndarray
        Monocular 3D pose in the axes of the optical frame, metres or up to scale; NaN where
        unknown: everywhere, where a pose estimator gives keypoints only.
    scores : (F, J) ndarray
        Confidence of each joint, 0..1.
    """

    track_id: int
    frames: IntArray
    keypoints: FloatArray
    joints: FloatArray
    scores: FloatArray

    def __getitem__(self, some: slice | BoolArray) -> Track:
        """The same person in some of the frames."""
        return Track(
            self.track_id,
            self.frames[some],
            self.keypoints[some],
            self.joints[some],
            self.scores[some],
        )


@dataclass(frozen=True, slots=True, eq=False)
class CameraRecording:
    """All tracks of one camera.

    Attributes
    ----------
    name : str
        The camera's name; unique in a `Recording`.
    frame_id : str
        Its optical frame.
    intrinsics : Intrinsics
    layout : Layout
        Joints of all its tracks.
    stamps : (N,) ndarray
        Acquisition times by the camera's own clock, seconds since `Recording.epoch_ns`,
        strictly increasing; images without a person are included.
    tracks : tuple of Track
    metric : bool
        The 3D poses are in metres.
    line_time_s : float
        Line delay of a rolling shutter: row v of an image is taken at
        ``stamp + line_time_s * v``; 0: all rows at once.
    received : (N,) ndarray or None
        Time at which a recorder received each image by the recorder's clock, which is one for all
        cameras: seconds since `Recording.epoch_ns`; NaN where unknown, None where nothing is.
    lens_knowledge : LensKnowledge or None
        What `intrinsics` are worth; None: as `Options.intrinsics` has it.
    lens_group : str
        Cameras of one group that is not empty have one lens: cameras of one model.
    lens_prior : LensPrior or None
        What is known of a lens that is to be estimated. None: by `lens_knowledge` and
        `Options.lens`.
    """

    name: str
    frame_id: str
    intrinsics: Intrinsics
    layout: Layout
    stamps: Float64Array
    tracks: tuple[Track, ...]
    metric: bool = False
    line_time_s: float = 0.0
    received: Float64Array | None = None
    lens_knowledge: LensKnowledge | None = None
    lens_group: str = ""
    lens_prior: LensPrior | None = None

    @property
    def has_3d_poses(self) -> bool:
        """Whether any 3D pose is known."""
        return any(bool(np.isfinite(track.joints[..., 0]).any()) for track in self.tracks)


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """The immutable input of a calibration.

    Attributes
    ----------
    cameras : tuple of CameraRecording
        In the order of the configuration; the first is the reference unless another is named.
    epoch_ns : int
        Zero of all stamps, nanoseconds since the Unix epoch.
    """

    cameras: tuple[CameraRecording, ...]
    epoch_ns: int = 0


def excerpt(
    recording: Recording,
    start_s: float,
    end_s: float,
    *,
    offsets_s: Mapping[str, float] | None = None,
) -> Recording:
    """Images with ``start_s <= stamp < end_s``; cameras without any stay, empty.

    Parameters
    ----------
    recording : Recording
    start_s, end_s : float
        Seconds since the epoch of the recording.
    offsets_s : mapping of str to float, optional
        Offset to add to the stamps of each camera before they are compared.
    """
    offsets = offsets_s or {}
    return replace(
        recording,
        cameras=tuple(
            _part(c, start_s - offsets.get(c.name, 0.0), end_s - offsets.get(c.name, 0.0))
            for c in recording.cameras
        ),
    )


def keypoints_only(recording: Recording, cameras: Collection[str] | None = None) -> Recording:
    """Return the recording without its monocular 3D poses: what a 2D pose estimator gives.

    Parameters
    ----------
    recording : Recording
    cameras : collection of str, optional
        Names of the cameras that have none. Default: all.

    Examples
    --------
    >>> import numpy as np
    >>> import stcalib_ros as st
    >>> scene = st.simulate(st.SceneOptions(n_cameras=2, n_frames=30))
    >>> mixed = st.keypoints_only(scene.recording, ["cam1"])
    >>> [bool(np.isfinite(camera.tracks[0].joints).any()) for camera in mixed.cameras]
    [True, False]
    """
    names = {camera.name for camera in recording.cameras} if cameras is None else set(cameras)
    return replace(
        recording,
        cameras=tuple(without_3d_poses(c) if c.name in names else c for c in recording.cameras),
    )


def without_3d_poses(camera: CameraRecording) -> CameraRecording:
    """Return a camera without its monocular 3D poses."""
    tracks = (replace(track, joints=unknown_joints(track.keypoints)) for track in camera.tracks)
    return replace(camera, tracks=tuple(tracks))


def unknown_joints(keypoints: FloatArray) -> FloatArray:
    """Return 3D poses (F, J, 3) that are unknown, for keypoints (F, J, 2); they take no memory."""
    nothing = np.array(np.nan, keypoints.dtype)
    return np.broadcast_to(nothing, (*keypoints.shape[:2], 3))


def only_images(camera: CameraRecording, used: BoolArray) -> CameraRecording:
    """Return a camera with some of its images (N,); tracks without any of them are left out."""
    number = np.cumsum(used) - 1
    parts = [track[used[track.frames]] for track in camera.tracks]
    return replace(
        camera,
        stamps=camera.stamps[used],
        tracks=tuple(replace(p, frames=number[p.frames]) for p in parts if len(p.frames)),
        received=None if camera.received is None else camera.received[used],
    )


def _part(camera: CameraRecording, start_s: float, end_s: float) -> CameraRecording:
    first, last = np.searchsorted(camera.stamps, [start_s, end_s])
    tracks = []
    for track in camera.tracks:
        a, b = np.searchsorted(track.frames, [first, last])
        if b > a:
            tracks.append(replace(track[a:b], frames=track.frames[a:b] - first))
    return replace(
        camera,
        stamps=camera.stamps[first:last],
        tracks=tuple(tracks),
        received=None if camera.received is None else camera.received[first:last],
    )
