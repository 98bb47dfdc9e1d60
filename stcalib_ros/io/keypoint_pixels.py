"""Pixels of keypoints that come as places of joints in the camera, or as fractions of the image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.io.messages import PoseImage

_CORNER_PX = 0.5
"""Pixels from the corner of an image, where its fractions begin, to the centre of its first pixel,
where pixels begin. By definition of the two."""


def with_pixels(image: PoseImage, lens: Intrinsics, info_topic: str) -> PoseImage:
    """Return an image with keypoints in pixels, whatever they come as.

    Parameters
    ----------
    image : PoseImage
    lens : Intrinsics
        Of the camera whose frame the joints are in.
    info_topic : str
        For error messages.

    Raises
    ------
    InputError
        The lens is not known.
    """
    if image.fractions:
        pixels = image.keypoints * np.array([lens.width, lens.height]) - _CORNER_PX
        return replace(image, keypoints=pixels.astype(np.float32), fractions=False)
    if not image.project or image.joints is None:
        return image
    if not lens.known:
        raise InputError(
            f"{info_topic}: the poses have no keypoints but 3D joints, which cannot be projected "
            "into the image without a lens; publish a CameraInfo with the lens of this camera"
        )
    pixels = project(image.joints.astype(np.float64), lens)
    return replace(image, keypoints=pixels.astype(np.float32), project=False)
