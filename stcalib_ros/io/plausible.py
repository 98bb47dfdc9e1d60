"""What values of files have to be, whichever format they come in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.camera_info import coefficient_counts
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.io.limits import (
    MAX_DISTANCE,
    MAX_IMAGE_SIDE,
    MAX_NAME,
    MAX_NUMBER,
    ROTATION_TOLERANCE,
)


def require_name(text: str, what: str) -> str:
    """Return a name that can be printed, sent and be part of a topic.

    Raises
    ------
    InputError
        It is empty, too long, or has characters that cannot be printed.
    """
    if not text or len(text) > MAX_NAME or not text.isprintable():
        raise InputError(
            f"{what}: expected a name of 1 to {MAX_NAME} printable characters, got "
            f"{text[:MAX_NAME]!r}"
        )
    return text


def require_size(size: Sequence[int], what: str) -> tuple[int, int]:
    """Return width and height of an image.

    Raises
    ------
    InputError
        A side is not of 1 to `MAX_IMAGE_SIDE` px.
    """
    width, height = (int(n) for n in size)
    if not 0 < min(width, height) <= max(width, height) <= MAX_IMAGE_SIDE:
        raise InputError(
            f"{what}: expected an image of 1 to {MAX_IMAGE_SIDE} px, got {width} x {height}"
        )
    return width, height


def require_lens(lens: Intrinsics, what: str) -> Intrinsics:
    """Return a lens through which a point can be projected.

    Raises
    ------
    InputError
        The image has no size, the matrix is no pinhole matrix, the distortion has another number
        of coefficients than its model, or a number is not finite.
    """
    require_size((lens.width, lens.height), what)
    K = lens.K
    if not (
        np.abs(K).max() <= MAX_NUMBER  # NaN compares false
        and min(K[0, 0], K[1, 1]) > 0
        and np.array_equal(K[2], [0, 0, 1])
    ):
        raise InputError(
            f"{what}: K is not a pinhole matrix (fx, fy > 0, last row 0 0 1): {K.tolist()}"
        )
    counts = coefficient_counts(lens.model)
    if lens.D.size not in counts or not np.all(np.abs(lens.D) <= MAX_NUMBER):
        raise InputError(
            f"{what}: expected {' or '.join(map(str, counts))} finite coefficients of "
            f"{lens.model.value}, got {lens.D.ravel().tolist()}"
        )
    require_rotation(lens.R_rect_cam, f"{what}: r")
    return lens


def require_rotation(R: Float64Array, what: str) -> Float64Array:
    """Return a rotation matrix.

    Raises
    ------
    InputError
        It is scaled, mirrored, or not finite.
    """
    finite = bool(np.all(np.abs(R) <= MAX_NUMBER))
    if not finite or np.abs(R @ R.T - np.eye(3)).max() > ROTATION_TOLERANCE or np.linalg.det(R) < 0:
        raise InputError(f"{what} is no rotation: {R.tolist()}")
    return R


def require_position(t: Float64Array, what: str) -> Float64Array:
    """Return x, y and z of a camera.

    Raises
    ------
    InputError
        It is further away than any camera, or not finite.
    """
    if not np.all(np.abs(t) <= MAX_DISTANCE):
        raise InputError(
            f"{what}: expected three numbers within {MAX_DISTANCE:g}, got {t.tolist()}"
        )
    return t
