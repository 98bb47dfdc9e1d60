"""What an export format is, and what several of them need."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration
from stcalib_ros.core.model.recording import LensModel
from stcalib_ros.core.reconstruction.trajectories import PersonTrajectory

Files = Mapping[str, str | bytes]
"""Content of files by their names."""

FISHEYE_COEFFICIENTS = 4
"""Coefficients of the equidistant model, in every format that has it."""

_POLYNOMIAL_COEFFICIENTS = 14
"""Most coefficients of OpenCV's polynomial model: k1 k2 p1 p2 k3 .. k6, thin prism, tilt."""

_HOLD_EVERY_LENS = "opencv, camera_info, npz"
"""Formats that any lens can be exported to."""


@dataclass(frozen=True, slots=True, eq=False)
class Exported:
    """What is exported.

    Attributes
    ----------
    calibration : Calibration
    people : sequence of PersonTrajectory
        Joints of people in its frame and unit; none without a recording.
    """

    calibration: Calibration
    people: Sequence[PersonTrajectory] = ()


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """A format that a calibration can be written in.

    Attributes
    ----------
    name : str
        As on the command line and in ``SaveCalibration``.
    summary : str
        What it is for.
    files : callable
        Takes what is exported and the name of the file or folder to be written, and returns the
        files: the one of that name, or those in the folder.
    endings : tuple of str
        What the name of the file may end in; none: the format is a folder of files.
    needs_metres : bool
        It has lengths in metres by its definition.
    takes_people : bool
        It has a place for people.
    """

    name: str
    summary: str
    files: Callable[[Exported, str], Files]
    endings: tuple[str, ...] = ()
    needs_metres: bool = False
    takes_people: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class PinholeView:
    """A camera as formats without a rectifying rotation have it.

    Attributes
    ----------
    R_view_ref : (3, 3) ndarray
    t_view_ref : (3,) ndarray
        ``x_view = R_view_ref @ x_ref + t_view_ref``, where the pinhole matrix holds in the axes of
        the view: those of the optical frame, unless keypoints are of a rectified image.
    """

    R_view_ref: Float64Array
    t_view_ref: Float64Array

    @property
    def T_view_ref(self) -> Float64Array:
        """The same as a homogeneous matrix (4, 4)."""
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = self.R_view_ref, self.t_view_ref
        return T


def view_of(camera: CameraCalibration) -> PinholeView:
    """Return the view of a camera whose lens is known.

    Raises
    ------
    InputError
        It is not known.
    """
    if not camera.intrinsics.known:
        raise InputError(
            f"camera {camera.name}: its lens is not known; calibrate with --intrinsics unknown"
        )
    R_view_ref = camera.intrinsics.R_rect_cam @ camera.R_ref_cam.T
    return PinholeView(R_view_ref, -R_view_ref @ camera.t_ref_cam)


def is_fisheye(camera: CameraCalibration) -> bool:
    """Whether its lens is of the equidistant model."""
    return camera.intrinsics.model is LensModel.EQUIDISTANT


def pinhole(camera: CameraCalibration) -> list[float]:
    """Return fx, fy, cx and cy, px, with the centre of the first pixel at 0."""
    K = camera.intrinsics.K
    return [float(value) for value in (K[0, 0], K[1, 1], K[0, 2], K[1, 2])]


def n_coefficients(camera: CameraCalibration) -> int:
    """Count the distortion coefficients up to the last one that is not zero."""
    return len(np.trim_zeros(camera.intrinsics.D, "b"))


def coefficients(camera: CameraCalibration, most: int, form: str) -> list[float]:
    """Return the distortion of a camera as so many coefficients in OpenCV's order.

    Parameters
    ----------
    camera : CameraCalibration
    most : int
        As many as the format has for OpenCV's polynomial model. Those of the equidistant model
        are `FISHEYE_COEFFICIENTS`.
    form : str
        Name of the format, for the message.

    Raises
    ------
    InputError
        The lens has more.
    """
    count = FISHEYE_COEFFICIENTS if is_fisheye(camera) else most
    if (needed := n_coefficients(camera)) > count:
        raise InputError(
            f"camera {camera.name}: {form} has {count} distortion coefficients, its lens "
            f"({camera.intrinsics.model.value}) has {needed}; formats for it: {_HOLD_EVERY_LENS}"
        )
    padded = np.zeros(_POLYNOMIAL_COEFFICIENTS)
    padded[: camera.intrinsics.D.size] = camera.intrinsics.D
    return [float(value) for value in padded[:count]]


def unique(names: Sequence[str], what: str) -> None:
    """Demand names that differ.

    Raises
    ------
    InputError
        Two do not.
    """
    if repeated := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"{what} {', '.join(repeated)}: more than one camera has it; rename one")
