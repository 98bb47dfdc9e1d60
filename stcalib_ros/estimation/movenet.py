"""MoveNet MultiPose: up to six people at once, 17 joints in 2D, at the cost of one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import FloatArray
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS, Layout
from stcalib_ros.estimation.letterbox import letterbox
from stcalib_ros.estimation.poses import ImagePoses, UInt8Array
from stcalib_ros.estimation.runtime import onnx_session

_MULTIPLE = 32
"""Pixels. Sides of the network's input are multiples of it: it halves the image five times."""

_SIZES = (128, 1024)
"""Pixels, lower and upper bound of the longer side of the input: below, people of a whole room have
too few pixels; above, the network, which was trained at 256, finds fewer of them again."""

_OFFSET_PX = -0.25
"""Pixels of the network's input from its coordinates to ours, in which the centre of the first
pixel is 0. Half the difference of an image and its mirror image, on the films of Pose2Sim's people:
python -m benchmarks.estimators."""

_MIN_PERSON = 0.15
"""Score, 0 to 1, below which a person is not one. In a film with a known truth, 0.3 loses 14 % of
the people in clear view at an input of 256 px, 0.2 some who are partly hidden; 0.05 invents some.
"""

_SAME_PERSON = 0.1
"""Mean distance of the joints of two persons as a fraction of the diagonal of the larger box, below
which they are the same one."""


class MoveNet:
    """Runs MoveNet MultiPose by ONNX Runtime.

    Parameters
    ----------
    path : Path
        Network, as `stcalib models fetch movenet` writes it.
    size : int
        Length of the longer side of the network's input, px; images are scaled to it.
    threads : int
        Threads of one image.

    Raises
    ------
    InputError
        The size is out of range, the file is no such network, or ONNX Runtime is not installed.
    """

    def __init__(self, path: Path, *, size: int = 256, threads: int = 1) -> None:
        low, high = _SIZES
        if not low <= size <= high:
            raise InputError(f"size of the input of movenet: expected {low} to {high}, got {size}")
        self._session = onnx_session(path, threads, "movenet")
        self._input = self._session.get_inputs()[0].name
        self._size = size

    @property
    def layout(self) -> Layout:
        """COCO's 17 joints."""
        return LAYOUTS["coco_17"]

    def poses(self, image: UInt8Array) -> ImagePoses:
        """Return the persons in an image (blue, green, red), best first; in 2D alone."""
        box = letterbox(image, self._size, _MULTIPLE)
        colours = box.image[None, :, :, ::-1].astype(np.float32)
        found = self._session.run(None, {self._input: colours})[0][0]
        n_joints = self.layout.n_joints
        found = found[found[:, -1] >= _MIN_PERSON].astype(np.float64)
        found = found[np.argsort(-found[:, -1], kind="stable")]
        parts = found[:, : 3 * n_joints].reshape(len(found), n_joints, 3)
        sides = np.array(box.image.shape[1::-1])
        keypoints = box.original(parts[..., 1::-1] * sides + _OFFSET_PX)
        keep = distinct(keypoints)
        joints = np.full((len(keep), n_joints, 3), np.nan)
        return ImagePoses(keypoints[keep], parts[keep, :, 2], joints)


def distinct(keypoints: FloatArray) -> list[int]:
    """Return which of the persons (P, J, 2), best first, are not the same as one before."""
    kept: list[int] = []
    for k, points in enumerate(keypoints):
        extent = np.hypot(*np.ptp(points, axis=0))
        others = keypoints[kept]
        extents = np.hypot(*np.ptp(others, axis=1).T)
        apart = np.linalg.norm(others - points, axis=-1).mean(axis=-1)
        if not np.any(apart < _SAME_PERSON * np.maximum(extent, extents)):
            kept.append(k)
    return kept
