"""BlazePose: 33 joints in 2D and 3D of one person, for each person that MoveNet finds.

BlazePose's own detector is made for one person in front of the camera, and misses most of those in
the back of a room.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from stcalib_ros.core.model.arrays import Float64Array, FloatArray
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS, Layout
from stcalib_ros.estimation.movenet import MoveNet
from stcalib_ros.estimation.poses import ImagePoses, UInt8Array
from stcalib_ros.estimation.runtime import LitertNetwork

_MIN_PERSON = 0.5
"""Probability, 0 to 1, that there is a person in a region, below which there is none: MediaPipe's
value."""

_MIN_HEAT = 0.5
"""Highest value of a joint's heat map, 0 to 1, from which it refines the joint: MediaPipe's."""

_HEAT_CELLS = 3
"""Cells of the heat map to each side of a joint that refine it: seven in a row, as in MediaPipe."""

_MIN_JOINT = 0.2
"""Score, 0 to 1, of MoveNet's joints that make the region of a person. Below, they are often joints
of somebody else; 0.1 to 0.3 make the same regions."""

_MARGIN = 2.75
"""Side of a region over the distance from the hips to the farthest joint: 1.25 times the diameter
of the person, as in MediaPipe, whose joints reach 10 % farther than MoveNet's: to toes and fingers.
"""

_COCO = LAYOUTS["coco_17"]
_HIPS = [_COCO.index(f"{side}_hip") for side in ("left", "right")]
_SHOULDERS = [_COCO.index(f"{side}_shoulder") for side in ("left", "right")]


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A square that contains a person.

    Attributes
    ----------
    centre : (2,) ndarray
        Middle of the hips, px.
    side : float
        Its length, px.
    angle : float
        Rotation of the person in the image, rad; 0 for one who is upright, positive for one whose
        head is to the right of their hips.
    """

    centre: FloatArray
    side: float
    angle: float


class BlazePose:
    """Runs BlazePose by LiteRT.

    Parameters
    ----------
    landmarks : Path
        Network, as `stcalib models fetch blazepose` writes it.
    finder : MoveNet
        Finds the persons.
    threads : int
        Threads of one image.

    Raises
    ------
    InputError
        A file is no such network, or LiteRT is not installed.
    """

    def __init__(self, landmarks: Path, finder: MoveNet, *, threads: int = 1) -> None:
        self._finder = finder
        self._network = LitertNetwork(landmarks, threads, "blazepose")

    @property
    def layout(self) -> Layout:
        """BlazePose's 33 joints."""
        return LAYOUTS["blazepose_33"]

    def poses(self, image: UInt8Array) -> ImagePoses:
        """Return the persons in an image (blue, green, red), in 2D and in 3D."""
        found = [self._pose(image, region) for region in regions(self._finder.poses(image))]
        persons = [pose for pose in found if pose is not None]
        n_joints = self.layout.n_joints
        return ImagePoses(
            np.array([pose[0] for pose in persons]).reshape(-1, n_joints, 2),
            np.array([pose[1] for pose in persons]).reshape(-1, n_joints),
            np.array([pose[2] for pose in persons]).reshape(-1, n_joints, 3),
        )

    def _pose(
        self, image: UInt8Array, region: Region
    ) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Return keypoints, scores and joints of the person in a region."""
        size = self._network.input_size
        to_image = _transform(region, size)
        crop = cv2.warpAffine(
            image, to_image, (size, size), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        )
        colours = crop[None, :, :, ::-1].astype(np.float32) / 255.0
        landmarks, person, _, heat, world = self._network(colours)
        if float(person.reshape(-1)[0]) < _MIN_PERSON:
            return None
        n_joints = self.layout.n_joints
        points = landmarks.reshape(-1, 5)[:n_joints].astype(np.float64)
        places = refined(points[:, :2] / size, heat[0, :, :, :n_joints]) * size - 0.5
        keypoints = places @ to_image[:, :2].T + to_image[:, 2]
        scores = _probability(points[:, 3])
        joints = world.reshape(-1, 3)[:n_joints].astype(np.float64)
        turn = to_image[:, :2] * (size / region.side)
        return keypoints, scores, np.hstack([joints[:, :2] @ turn.T, joints[:, 2:]])


def regions(poses: ImagePoses) -> list[Region]:
    """Return the regions of persons with COCO's 17 joints."""
    found = []
    for keypoints, scores in zip(poses.keypoints, poses.scores, strict=True):
        hips = keypoints[_HIPS].mean(axis=0)
        up = keypoints[_SHOULDERS].mean(axis=0) - hips
        seen = keypoints[scores >= _MIN_JOINT]
        reach = float(np.hypot(*(seen - hips).T).max(initial=0.0))
        if reach > 1.0:  # px; otherwise there is nobody
            found.append(Region(hips, _MARGIN * reach, float(np.arctan2(up[0], -up[1]))))
    return found


def _transform(region: Region, size: int) -> FloatArray:
    """Return the map (2, 3) from pixels of the upright square of a person to those of the image."""
    cos, sin = np.cos(region.angle), np.sin(region.angle)
    linear = region.side / size * np.array([[cos, -sin], [sin, cos]])
    middle = np.full(2, (size - 1) / 2.0)
    return np.column_stack([linear, region.centre - linear @ middle])


def _probability(logits: FloatArray) -> Float64Array:
    limited = np.clip(logits.astype(np.float64), -100.0, 100.0)
    return np.asarray(1.0 / (1.0 + np.exp(-limited)))


def refined(points: FloatArray, heat: FloatArray) -> FloatArray:
    """Move joints to the mean of their heat around them, where there is enough of it.

    Parameters
    ----------
    points : (J, 2) ndarray
        Fractions of the image, x and y.
    heat : (height, width, J) ndarray
        Logits of the heat maps.
    """
    height, width, _ = heat.shape
    result = points.astype(np.float64)
    for joint, (x, y) in enumerate(points):
        column, row = int(x * width), int(y * height)
        if not (0 <= column < width and 0 <= row < height):
            continue
        rows = slice(max(row - _HEAT_CELLS, 0), row + _HEAT_CELLS + 1)
        columns = slice(max(column - _HEAT_CELLS, 0), column + _HEAT_CELLS + 1)
        weights = _probability(heat[rows, columns, joint])
        if weights.max() < _MIN_HEAT:
            continue
        middle_x = np.arange(width)[columns] @ weights.sum(axis=0)
        middle_y = np.arange(height)[rows] @ weights.sum(axis=1)
        result[joint] = np.array([middle_x / width, middle_y / height]) / weights.sum()
    return result
