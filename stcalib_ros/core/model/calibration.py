"""The result of a calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.lens_knowledge import LensKnowledge, LensStddev
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.core.model.rejection import Rejection, Remark
from stcalib_ros.core.model.rejection_text import camera_sentence, sentence


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
        Those given, or those estimated.
    R_ref_cam : (3, 3) ndarray
    t_ref_cam : (3,) ndarray
        ``x_ref = R_ref_cam @ x_cam + t_ref_cam``; the camera's centre in the reference frame.
    covariance : (6, 6) ndarray
        Covariance of x, y, z, rotX, rotY, rotZ (rotation about the fixed axes of the reference
        frame, rad).
    time_offset_s, time_offset_stddev_s : float
        ``t_ref = t_cam + time_offset_s + clock_skew * (t_cam - epoch)``.
    clock_skew, clock_skew_stddev : float
        Dimensionless. A skew of 0 with a standard deviation of more than 1e-5 is not observable in
        a recording that short; this is the standard deviation that it would have had. NaN where
        it was not asked for.
    line_time_s, line_time_stddev_s : float
        Line delay of a rolling shutter, seconds per row: the offset holds for row 0. The standard
        deviation is NaN where the line delay was not estimated. One that is not observable is
        the given one, with the standard deviation that it would have had.
    lens_knowledge : LensKnowledge
        Whether the intrinsics were given, or estimated from what was known of them.
    lens_stddev : LensStddev or None
        How well they are known; None where they were given.
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
    lens_knowledge: LensKnowledge = LensKnowledge.GIVEN
    lens_stddev: LensStddev | None = None


@dataclass(frozen=True, slots=True)
class PersonAssociation:
    """One person: their tracks in every camera that observed them.

    Attributes
    ----------
    person_id : int
    tracks : mapping of str to tuple of int
        Track ids by camera name.
    reprojection_rms_px : float
        Root mean square over the inliers of this person.
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
        Number of persons that both observe.
    median_angle_rad : float
        Median angle between the bone directions of the two monocular poses after rotation; NaN
        without 3D poses.
    epipolar_rms_px : float
        Robust Sampson distance of the matched keypoints.
    """

    camera_a: str
    camera_b: str
    n_matches: int
    median_angle_rad: float
    epipolar_rms_px: float


@dataclass(frozen=True, slots=True)
class UncalibratedCamera:
    """A camera that could not be connected to the others.

    Attributes
    ----------
    name : str
    rejection : Rejection
        Why; its cameras are the group of connected cameras that this one belongs to.
    """

    name: str
    rejection: Rejection

    @property
    def reason(self) -> str:
        """The rejection as a sentence."""
        return camera_sentence(self.name, self.rejection)


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """The result of a calibration.

    Attributes
    ----------
    status : Status
        Only ``OK`` is a calibration to be used.
    message : str
        Summary in one line for people, made from the records below.
    reference : str
        Camera whose clock is the reference, and whose optical frame unless `frame_id` names
        another.
    metric : bool
        Lengths are metres; else the unit is the distance between the first two cameras.
    epoch_s : float
        Time (Unix seconds) at which the offsets hold.
    window_s : (float, float)
        First and last stamp used (Unix seconds, reference clock).
    cameras : tuple of CameraCalibration
    uncalibrated : tuple of UncalibratedCamera
    persons : tuple of PersonAssociation
    pairs : tuple of PairResidual
    reprojection_rms_px : float
        Root mean square over the inliers (E_2D in the paper).
    n_observations, n_inliers : int
        Number of keypoints of associated persons, and of inliers among them.
    joint_covariance : (7 C, 7 C) ndarray
        Covariance of all cameras together, in `parameter_order`, with the unit of length as known.
    parameter_order : tuple of str
        ``"cam1.x"``, ..., ``"cam1.rot_z"``, ``"cam1.time_offset_s"``, ...
    frame_id : str
        Frame of the poses, z up and the floor at 0; empty: that of the reference camera.
    scale_stddev : float
        Relative standard deviation of the unit of length; NaN if not metric.
    rejections : tuple of Rejection
        Why the calibration is not to be used, the most important first; with ``OK``, what explains
        that cameras were left out.
    remarks : tuple of Remark
        What could be better about a calibration that can be used.
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
    rejections: tuple[Rejection, ...] = ()
    remarks: tuple[Remark, ...] = ()

    def __str__(self) -> str:
        """Return a short table: status, and a row for each camera."""
        unit = "m" if self.metric else "baselines"
        head = f"{self.status.name}, {self.reprojection_rms_px:.2f} px, positions in {unit}"
        width = max((len(camera.name) for camera in self.cameras), default=0)
        rows = [
            f"{camera.name:<{width}}  x {x:+.3f}  y {y:+.3f}  z {z:+.3f}  "
            f"clock {1e3 * camera.time_offset_s:+.1f} ms"
            for camera in self.cameras
            for x, y, z in [camera.t_ref_cam]
        ]
        missing = [f"{camera.name}: not calibrated" for camera in self.uncalibrated]
        reason = [] if self.status is Status.OK else [self.message]
        return "\n".join([head, *reason, *rows, *missing])

    @property
    def reference_frame(self) -> str:
        """Frame that the poses are expressed in; empty if there are no cameras."""
        frames = {camera.name: camera.frame_id for camera in self.cameras}
        return self.frame_id or frames.get(self.reference, "")

    @property
    def reasons(self) -> tuple[Rejection, ...]:
        """All rejections: those of the calibration, then those of single cameras; each once."""
        found = list(self.rejections)
        found += [c.rejection for c in self.uncalibrated if c.rejection not in found]
        return tuple(r for i, r in enumerate(found) if r not in found[:i])


class Insufficient(Exception):
    """The data cannot be calibrated; becomes a `Calibration` with that status.

    Attributes
    ----------
    status : Status
    rejection : Rejection
    uncalibrated : tuple of UncalibratedCamera
    """

    def __init__(
        self,
        status: Status,
        rejection: Rejection,
        uncalibrated: Sequence[UncalibratedCamera] = (),
    ) -> None:
        super().__init__(sentence(rejection))
        self.status, self.rejection = status, rejection
        self.uncalibrated = tuple(uncalibrated)
