"""The lens of a camera from the numbers of a ``sensor_msgs/CameraInfo``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.recording import Intrinsics, LensModel, unknown_intrinsics

_COEFFICIENTS = {
    LensModel.PLUMB_BOB: (0, 4, 5),
    LensModel.RATIONAL_POLYNOMIAL: (0, 8, 12, 14),
    LensModel.EQUIDISTANT: (0, 4),
}
"""How many coefficients D may have; none means no distortion."""

_POLYNOMIALS = (LensModel.PLUMB_BOB, LensModel.RATIONAL_POLYNOMIAL)
"""One model, in order of length: OpenCV's D goes on with k4, k5, k6, whatever a driver calls it."""

_CALIBRATE = "calibrate its lens first (e.g. with camera_calibration)"


def coefficient_counts(model: LensModel) -> tuple[int, ...]:
    """Return how many distortion coefficients a lens model may have; none means no distortion."""
    return _COEFFICIENTS[model]


def intrinsics_from_camera_info(
    *,
    width: int,
    height: int,
    distortion_model: str,
    d: Sequence[float] | Float64Array,
    k: Sequence[float] | Float64Array,
    r: Sequence[float] | Float64Array,
    p: Sequence[float] | Float64Array,
    binning_x: int = 0,
    binning_y: int = 0,
    roi: tuple[int, int, int, int] = (0, 0, 0, 0),
    rectified: bool,
) -> Intrinsics:
    """Lens for the pixels of the image that a camera publishes.

    As ROS has it, K and P are those of the full sensor; the image is its region of interest,
    then binned: ``u_image = (u_sensor - x_offset) / binning_x``.

    Parameters
    ----------
    width, height : int
        Size of the full sensor, px.
    distortion_model : str
        ``plumb_bob``, ``rational_polynomial`` or ``equidistant``; may be empty if `d` is all zero,
        and anything where the lens is not known.
    d : sequence of float
        Distortion coefficients in OpenCV's order.
    k : sequence of 9 floats
        Row-major pinhole matrix of the raw image, px.
    r : sequence of 9 floats
        Row-major rotation of the optical frame to the rectified one.
    p : sequence of 12 floats
        Row-major projection of the rectified image, px. Its last column, the baseline of a
        stereo pair, is not used: poses are those of the camera's own centre.
    binning_x, binning_y : int
        Sensor pixels per image pixel; 0 means 1.
    roi : (x_offset, y_offset, width, height)
        In sensor pixels; a width or height of 0 reaches to the edge.
    rectified : bool
        The keypoints are in the rectified image: `p` and `r` hold, and there is no distortion.

    Returns
    -------
    Intrinsics
        For the image's own pixels; of a camera that is not calibrated, as the first number of the
        matrix says by 0, they are not known but for the size of the image.

    Raises
    ------
    InputError
        The lens model is unknown, or numbers are missing or absurd.
    """
    matrix = _numbers("P", p, (3, 4))[:, :3] if rectified else _numbers("K", k, (3, 3))
    x_offset, y_offset, roi_width, roi_height = _region(roi, width, height)
    bin_x, bin_y = max(binning_x, 1), max(binning_y, 1)
    size = roi_width // bin_x, roi_height // bin_y
    sensor = (-x_offset / bin_x, -y_offset / bin_y, width / bin_x, height / bin_y)
    R_rect_cam = _rotation(r) if rectified and (matrix.any() or np.any(r)) else np.eye(3)
    if matrix[0, 0] == 0:
        return replace(unknown_intrinsics(*size), R_rect_cam=R_rect_cam, sensor=sensor)
    _check_pinhole("P" if rectified else "K", matrix)
    image_from_sensor = np.array(
        [[1 / bin_x, 0, -x_offset / bin_x], [0, 1 / bin_y, -y_offset / bin_y], [0, 0, 1]]
    )
    model, coefficients = (
        (LensModel.PLUMB_BOB, np.zeros(0)) if rectified else _lens(distortion_model, d)
    )
    return Intrinsics(
        *size,
        model=model,
        K=image_from_sensor @ matrix,
        D=coefficients,
        R_rect_cam=R_rect_cam,
        sensor=sensor,
    )


def _numbers(
    name: str, given: Sequence[float] | Float64Array, shape: tuple[int, ...]
) -> Float64Array:
    values = np.array(given, dtype=np.float64).ravel()
    if values.size != np.prod(shape):
        raise InputError(f"CameraInfo.{name}: expected {np.prod(shape)} numbers, got {values.size}")
    if not np.isfinite(values).all():
        raise InputError(f"CameraInfo.{name} is not finite: {values.tolist()}; {_CALIBRATE}")
    return values.reshape(shape)


def _check_pinhole(name: str, matrix: Float64Array) -> None:
    if matrix[0, 0] < 0 or matrix[1, 1] <= 0 or not np.array_equal(matrix[2], [0, 0, 1]):
        raise InputError(
            f"CameraInfo.{name} is not a pinhole matrix (fx, fy > 0, last row 0 0 1): "
            f"{matrix.tolist()}; {_CALIBRATE}"
        )


def _region(roi: tuple[int, int, int, int], width: int, height: int) -> tuple[int, int, int, int]:
    if width <= 0 or height <= 0:
        raise InputError(f"CameraInfo: image of {width} x {height} px; let the driver fill them in")
    x, y, w, h = roi
    w, h = w or width - x, h or height - y
    if min(x, y) < 0 or min(w, h) <= 0 or x + w > width or y + h > height:
        raise InputError(
            f"CameraInfo.roi (x, y, width, height) = {roi} is not within the sensor of "
            f"{width} x {height} px"
        )
    return x, y, w, h


def _lens(name: str, d: Sequence[float] | Float64Array) -> tuple[LensModel, Float64Array]:
    coefficients = np.array(d, dtype=np.float64).ravel()
    if not np.isfinite(coefficients).all():
        raise InputError(f"CameraInfo.D is not finite: {coefficients.tolist()}; {_CALIBRATE}")
    if not name and not coefficients.any():
        return LensModel.PLUMB_BOB, np.zeros(0)
    try:
        named = LensModel(name)
    except ValueError:
        known = ", ".join(m.value for m in LensModel)
        raise InputError(
            f"unknown CameraInfo.distortion_model {name!r}: use one of {known}, "
            "or rectify the images and set rectified"
        ) from None
    models = (named, *_POLYNOMIALS) if named in _POLYNOMIALS else (named,)
    for model in models:
        if (fitting := _fitting(coefficients, _COEFFICIENTS[model])) is not None:
            return model, fitting
    counts = ", ".join(map(str, _COEFFICIENTS[named]))
    raise InputError(
        f"CameraInfo.D has {coefficients.size} coefficients: {name} takes {counts}, or more that "
        "are zero"
    )


def _fitting(coefficients: Float64Array, counts: tuple[int, ...]) -> Float64Array | None:
    """Coefficients in one of the numbers that a model takes, without zeros at the end if need be.

    Drivers fill D up with zeros: plumb_bob with 8 coefficients of which 3 are zero.
    """
    n_needed = len(np.trim_zeros(coefficients, "b"))
    possible = [n for n in counts if n_needed <= n <= coefficients.size]
    return coefficients[: max(possible)] if possible else None


def _rotation(r: Sequence[float] | Float64Array) -> Float64Array:
    R = _numbers("R", r, (3, 3))
    if not np.allclose(R @ R.T, np.eye(3), atol=1e-3) or np.linalg.det(R) < 0:
        raise InputError(
            f"CameraInfo.R is no rotation: {R.tolist()}; "
            "a camera that is not one of a stereo pair has the identity"
        )
    return R
