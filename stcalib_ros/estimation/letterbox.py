"""Images as networks take them: at their size, with what is missing filled up."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stcalib_ros.core.model.arrays import FloatArray
from stcalib_ros.estimation.poses import UInt8Array


@dataclass(frozen=True, slots=True, eq=False)
class Letterbox:
    """An image scaled to the size of a network, and the way back for its pixels.

    Attributes
    ----------
    image : (height, width, 3) ndarray of uint8
        Scaled, at the upper left; the rest is black.
    scale : (2,) ndarray
        Pixels of `image` per pixel of the original, along x and y.
    """

    image: UInt8Array
    scale: FloatArray

    def original(self, points: FloatArray) -> FloatArray:
        """Return points (..., 2) of `image` as points of the original.

        In both, the centres of pixels are at whole numbers; scaling keeps the edges of the image,
        which are half a pixel outside of the outer centres.
        """
        return np.asarray((points + 0.5) / self.scale - 0.5)


def letterbox(image: UInt8Array, longest: int, multiple: int) -> Letterbox:
    """Scale an image.

    Parameters
    ----------
    image : (height, width, 3) ndarray of uint8
    longest : int
        Wanted length of the longer side, px.
    multiple : int
        Both sides of the result are multiples of it, px.
    """
    height, width = image.shape[:2]
    ratio = longest / max(height, width)
    new = max(round(width * ratio), 1), max(round(height * ratio), 1)
    method = cv2.INTER_AREA if ratio < 1 else cv2.INTER_LINEAR
    scaled = cv2.resize(image, new, interpolation=method)
    sides = [-(-side // multiple) * multiple for side in (new[1], new[0])]
    filled = np.zeros((*sides, 3), np.uint8)
    filled[: new[1], : new[0]] = scaled
    return Letterbox(filled, np.array([new[0] / width, new[1] / height]))
