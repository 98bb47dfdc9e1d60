"""The records that everything else works on: what was seen, and what came out.

Frames are in the names: ``R_ref_cam`` turns coordinates of the camera's optical frame
(x right, y down, z forward) into those of the reference frame. Times are float64 seconds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, IntEnum

import numpy as np
from numpy.typing import NDArray

from stcalib_ros.core.layouts import Layout

FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


class LensModel(Enum):
    """Lens models of ``sensor_msgs/CameraInfo.distortion_model``."""

    PLUMB_BOB = "plumb_bob"
    RATIONAL_POLYNOMIAL = "rational_polynomial"
    EQUIDISTANT = "equidistant"


@dataclass(frozen=True, slots=True, eq=False)
class Intrinsics:
    """Lens of one camera, for the pixels that its key points are given in.

    Attributes
    ----------
    width, height : int
        Size of the image in px (after binning and region of interest).
    model : LensModel
        How `D` is to be read.
    K : (3, 3) ndarray
        Pinhole matrix, px.
    D : (n,) ndarray
        Distortion coefficients in OpenCV's order; empty or zero: none.
    R_rect_cam : (3, 3) ndarray
        Optical frame to the frame in which `K` holds; not the identity only for rectified
        key points of a stereo pair.
    """

    width: int
    height: int
    model: LensModel
    K: FloatArray
    D: FloatArray
    R_rect_cam: FloatArray = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One person as one camera's own tracker saw him: gaps, fragments and id switches included.

    Poses are float64, or the float32 of messages, which takes half of the memory.

    Attributes
    ----------
    track_id : int
        Of this camera's tracker; not shared between cameras.
    frames : (F,) ndarray of int
        Strictly increasing indices into the stamps of the camera.
    keypoints : (F, J, 2) ndarray
        Image positions, px; NaN where not seen.
    joints : (F, J, 3) ndarray
        Monocular 3D pose in the axes of the optical frame, metres or up to scale; NaN where
        unknown.
    scores : (F, J) ndarray
        Confidence of each joint, 0..1.
    """

    track_id: int
    frames: IntArray
    keypoints: FloatArray
    joints: FloatArray
    scores: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class CameraRecording:
    """All that one camera saw.

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
        strictly increasing; images without a person are among them.
    tracks : tuple of Track
    metric : bool
        The 3D poses are in metres.
    line_time_s : float
        Of a rolling shutter: row v of an image is taken at ``stamp + line_time_s * v``; 0: all
        rows at once.
    """

    name: str
    frame_id: str
    intrinsics: Intrinsics
    layout: Layout
    stamps: FloatArray
    tracks: tuple[Track, ...]
    metric: bool = False
    line_time_s: float = 0.0


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


class Status(IntEnum):
    """Verdict on a calibration; the values are those of ``CalibrationResult.status``."""

    OK = 0
    DEGENERATE = 1
    INSUFFICIENT_DATA = 2
    NOT_CONVERGED = 3
    CANCELLED = 4


@dataclass(frozen=True, slots=True, eq=False)
class CameraCalibration:
    """Pose and clock of one camera.

    Attributes
    ----------
    name, frame_id : str
    intrinsics : Intrinsics
    R_ref_cam : (3, 3) ndarray
    t_ref_cam : (3,) ndarray
        ``x_ref = R_ref_cam @ x_cam + t_ref_cam``; the camera's centre in the reference frame.
    covariance : (6, 6) ndarray
        Of x, y, z, rotX, rotY, rotZ (rotation about the fixed axes of the reference frame, rad).
    time_offset_s, time_offset_stddev_s : float
        ``t_ref = t_cam + time_offset_s + clock_skew * (t_cam - epoch)``.
    clock_skew, clock_skew_stddev : float
        Dimensionless. A skew of 0 with a deviation of more than 1e-5: the recording is too short
        to tell it, and this is how well it would. NaN where it was not asked for.
    line_time_s, line_time_stddev_s : float
        Of a rolling shutter, seconds per row: the offset holds for row 0. The deviation is NaN
        where the line time was not estimated. One that the recording does not tell is the given
        one, with the deviation that it would have had.
    """

    name: str
    frame_id: str
    intrinsics: Intrinsics
    R_ref_cam: FloatArray
    t_ref_cam: FloatArray
    covariance: FloatArray
    time_offset_s: float
    time_offset_stddev_s: float
    clock_skew: float = 0.0
    clock_skew_stddev: float = float("nan")
    line_time_s: float = 0.0
    line_time_stddev_s: float = float("nan")


@dataclass(frozen=True, slots=True)
class PersonAssociation:
    """One person: his tracks in every camera that saw him.

    Attributes
    ----------
    person_id : int
    tracks : mapping of str to tuple of int
        Track ids by camera name.
    reprojection_rms_px : float
        Of the inliers of this person.
    margin : float
        How many times worse the next best assignment is; inf if there is none.
    """

    person_id: int
    tracks: Mapping[str, tuple[int, ...]]
    reprojection_rms_px: float
    margin: float = float("inf")


@dataclass(frozen=True, slots=True)
class PairResidual:
    """How well two cameras agree.

    Attributes
    ----------
    camera_a, camera_b : str
    n_matches : int
        Persons that both see.
    median_angle_rad : float
        Between the bone directions of the two monocular poses after rotation.
    epipolar_rms_px : float
        Robust Sampson distance of the matched key points.
    """

    camera_a: str
    camera_b: str
    n_matches: int
    median_angle_rad: float
    epipolar_rms_px: float


@dataclass(frozen=True, slots=True)
class UncalibratedCamera:
    """A camera that could not be tied to the others, and why."""

    name: str
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """The result of a calibration.

    Attributes
    ----------
    status : Status
        Only ``OK`` is a calibration to be used.
    message : str
        For a person: what was found, or why not and what to do.
    reference : str
        Camera whose clock is the reference, and whose optical frame unless `frame_id` names
        another.
    metric : bool
        Lengths are metres; else the unit is the distance between the first two cameras.
    epoch_s : float
        Stamp (Unix seconds) at which the offsets hold.
    window_s : (float, float)
        First and last stamp used (Unix seconds, reference clock).
    cameras : tuple of CameraCalibration
    uncalibrated : tuple of UncalibratedCamera
    persons : tuple of PersonAssociation
    pairs : tuple of PairResidual
    reprojection_rms_px : float
        Of the inliers (the paper's E_2D).
    n_observations, n_inliers : int
        Image points looked at and image points used.
    joint_covariance : (7 C, 7 C) ndarray
        Of all cameras together, in `parameter_order`; the unit of length counts as known.
    parameter_order : tuple of str
        ``"cam1.x"``, ..., ``"cam1.rot_z"``, ``"cam1.time_offset_s"``, ...
    frame_id : str
        Frame of the poses, z up and the floor at 0; empty: that of the reference camera.
    scale_stddev : float
        Standard deviation of a metre of the result, as a share of it; NaN if not metric.
    """

    status: Status
    message: str
    reference: str
    metric: bool
    epoch_s: float
    window_s: tuple[float, float]
    cameras: tuple[CameraCalibration, ...]
    uncalibrated: tuple[UncalibratedCamera, ...]
    persons: tuple[PersonAssociation, ...]
    pairs: tuple[PairResidual, ...]
    reprojection_rms_px: float
    n_observations: int
    n_inliers: int
    joint_covariance: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    parameter_order: tuple[str, ...] = ()
    frame_id: str = ""
    scale_stddev: float = float("nan")

    @property
    def reference_frame(self) -> str:
        """Frame that the poses are expressed in; empty if there are no cameras."""
        frames = {camera.name: camera.frame_id for camera in self.cameras}
        return self.frame_id or frames.get(self.reference, "")

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the message of a good calibration says beyond how many cameras it has."""
        if self.status is not Status.OK:
            return ()
        sentences = self.message.split("; ")[1:]
        return tuple(f"{text[:1].upper()}{text[1:]}." for text in sentences)
