"""Poses of persons in the optical frames of their cameras."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from stcalib_ros.core.model.arrays import BoolArray, Float64Array, FloatArray, IntArray
from stcalib_ros.core.model.lens_knowledge import LensKnowledge, LensPrior
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.core.model.rolling_shutter import GLOBAL, Shutter


@dataclass(frozen=True, slots=True, eq=False)
class LiftedTrack:
    """One track in the metric frame of its camera, as precise as the recording is.

    Attributes
    ----------
    track_id : int
    frames : (F,) ndarray of int
        Indices into the stamps of the camera.
    x : (F, J, 2) ndarray
        Undistorted keypoints on the plane z = 1; NaN where not used.
    focal : (F, J) ndarray
        Pixels per unit of `x`.
    joints_cam : (F, J, 3) ndarray
        Joints in the optical frame, metres; NaN where no 3D pose is known.
    root_cam : (F, 3) ndarray
        Middle of the body in the optical frame, metres by the size of an adult: the mean of
        `joints_cam`, or, where that is not known, by the apparent size of the limbs; NaN where
        neither is.
    rows : (F, J) ndarray or None
        Rows of the keypoints in the image, px, counted from the middle row of the shutter; None
        where all shutters take all rows at once.
    """

    track_id: int
    frames: IntArray
    x: FloatArray
    focal: FloatArray
    joints_cam: FloatArray
    root_cam: FloatArray
    rows: FloatArray | None = None

    def __getitem__(self, some: slice | BoolArray) -> LiftedTrack:
        """The same person in some of the frames."""
        return LiftedTrack(
            self.track_id,
            self.frames[some],
            self.x[some],
            self.focal[some],
            self.joints_cam[some],
            self.root_cam[some],
            None if self.rows is None else self.rows[some],
        )


@dataclass(frozen=True, slots=True, eq=False)
class LiftedCamera:
    """All lifted tracks of one camera.

    Attributes
    ----------
    name : str
    stamps : (N,) ndarray
        Seconds by its own clock; of the middle row of its shutter.
    tracks : tuple of LiftedTrack
    shutter : Shutter
    received : (N,) ndarray or None
        Time at which a recorder received each image, as in `CameraRecording`.
    intrinsics : Intrinsics, optional
        Lens by which its keypoints were undistorted.
    lens_knowledge : LensKnowledge
        What this lens is worth.
    lens_group : str
        Cameras of one group that is not empty have one lens.
    lens_prior : LensPrior or None
        What was known of a lens that is to be estimated; None of one that is given.
    """

    name: str
    stamps: Float64Array
    tracks: tuple[LiftedTrack, ...]
    shutter: Shutter = GLOBAL
    received: Float64Array | None = None
    intrinsics: Intrinsics | None = None
    lens_knowledge: LensKnowledge = LensKnowledge.GIVEN
    lens_group: str = ""
    lens_prior: LensPrior | None = None


def time_span(cameras: Sequence[LiftedCamera], offset_s: Iterable[float]) -> tuple[float, float]:
    """First and last image of some cameras, seconds by the reference clock.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
    offset_s : iterable of float
        Time offset of each of them, seconds.
    """
    starts, ends = zip(
        *(
            (camera.stamps[0] + offset, camera.stamps[-1] + offset)
            for camera, offset in zip(cameras, offset_s, strict=True)
        ),
        strict=True,
    )
    return float(min(starts)), float(max(ends))
