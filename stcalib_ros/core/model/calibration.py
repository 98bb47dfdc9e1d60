"""The result of a calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.recording import Intrinsics


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
    R_ref_cam: Float64Array
    t_ref_cam: Float64Array
    covariance: Float64Array
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
    joint_covariance: Float64Array = field(default_factory=lambda: np.zeros((0, 0)))
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
