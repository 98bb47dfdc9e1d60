"""Pixels of ``sensor_msgs/Image`` and ``CompressedImage``, as OpenCV has them."""

from __future__ import annotations

import cv2
import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.estimation.poses import UInt8Array

_CODES: dict[str, tuple[int, int | None]] = {
    "bgr8": (3, None),
    "8UC3": (3, None),
    "rgb8": (3, cv2.COLOR_RGB2BGR),
    "bgra8": (4, cv2.COLOR_BGRA2BGR),
    "8UC4": (4, cv2.COLOR_BGRA2BGR),
    "rgba8": (4, cv2.COLOR_RGBA2BGR),
    "mono8": (1, cv2.COLOR_GRAY2BGR),
    "8UC1": (1, cv2.COLOR_GRAY2BGR),
    "yuv422": (2, cv2.COLOR_YUV2BGR_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2BGR_YUY2),
    "yuyv": (2, cv2.COLOR_YUV2BGR_YUY2),
    "yuy2": (2, cv2.COLOR_YUV2BGR_YUY2),
    "bayer_rggb8": (1, cv2.COLOR_BayerBG2BGR),
    "bayer_bggr8": (1, cv2.COLOR_BayerRG2BGR),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGR2BGR),
    "bayer_grbg8": (1, cv2.COLOR_BayerGB2BGR),
}
"""Bytes of a pixel, and the conversion to blue, green, red. OpenCV names the patterns of Bayer by
the second row and column, ROS by the first."""


def image_pixels(*, encoding: str, height: int, width: int, step: int, data: bytes) -> UInt8Array:
    """Return the pixels of an image, (height, width, 3): blue, green, red.

    Parameters
    ----------
    encoding : str
        As in ``sensor_msgs/image_encodings``.
    height, width : int
        Size, px.
    step : int
        Bytes of a row, padding included.
    data : bytes-like

    Raises
    ------
    InputError
        The encoding is not one of those read here, or the data are too short for the size.
    """
    if (code := _CODES.get(encoding)) is None:
        raise InputError(
            f"encoding {encoding[:_MAX_NAME]!r} is not read: have the driver, or image_proc, send "
            f"one of {', '.join(_CODES)}"
        )
    n_bytes, conversion = code
    given = np.frombuffer(data, dtype=np.uint8)
    if not (height and width) or step < width * n_bytes or len(given) < height * step:
        raise InputError(
            f"{len(given)} bytes in rows of {step} are no image of {width} x {height} in {encoding}"
        )
    rows = given[: height * step].reshape(height, step)[:, : width * n_bytes]
    pixels = np.ascontiguousarray(rows).reshape(height, width, n_bytes)
    return pixels if conversion is None else _converted(pixels, conversion, encoding)


def compressed_pixels(data: bytes) -> UInt8Array:
    """Return the pixels of a JPEG or PNG, (height, width, 3): blue, green, red.

    Raises
    ------
    InputError
        OpenCV cannot decode it.
    """
    given = np.frombuffer(data, dtype=np.uint8)
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        decoded = cv2.imdecode(given, flags) if len(given) else None
    except cv2.error:
        decoded = None
    if decoded is None:
        raise InputError(f"{len(given)} bytes are no JPEG or PNG that can be decoded")
    return np.asarray(decoded, dtype=np.uint8)


_MAX_NAME = 40
"""Characters of an unknown encoding that are repeated. Chosen: names have up to 20."""


def _converted(pixels: UInt8Array, conversion: int, encoding: str) -> UInt8Array:
    try:
        return np.asarray(cv2.cvtColor(pixels, conversion), dtype=np.uint8)
    except cv2.error:
        height, width = pixels.shape[:2]
        raise InputError(f"{width} x {height} pixels cannot be {encoding}") from None
