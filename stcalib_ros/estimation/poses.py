"""What a pose estimator finds in one image, and what such an estimator is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from stcalib_ros.core.model.arrays import FloatArray
from stcalib_ros.core.model.keypoint_layouts import Layout

UInt8Array = NDArray[np.uint8]
"""An image: (height, width, 3), in OpenCV's order of colours, blue first."""


@dataclass(frozen=True, slots=True, eq=False)
class ImagePoses:
    """The persons in one image, in no order: an estimator knows nothing of other images.

    Attributes
    ----------
    keypoints : (P, J, 2) ndarray
        Positions of joints, px of the image, centres of pixels at whole numbers; NaN where a joint
        was not found.
    scores : (P, J) ndarray
        Confidence of each joint, 0..1.
    joints : (P, J, 3) ndarray
        Monocular 3D pose about any origin, in the axes of the optical frame (x right, y down, z
        forward), metres; NaN where the estimator gives none.
    """

    keypoints: FloatArray
    scores: FloatArray
    joints: FloatArray


class PoseEstimator(Protocol):
    """Finds persons in images; one object is used by one thread at a time."""

    @property
    def layout(self) -> Layout:
        """Joints of all the poses that it returns."""
        ...

    def poses(self, image: UInt8Array) -> ImagePoses:
        """Return the persons in an image.

        Parameters
        ----------
        image : (height, width, 3) ndarray of uint8
            Blue, green, red; of any size.
        """
        ...
