"""Where people are in the images of a film: by the truth of ours, or by OpenPose in others'."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.film.compare import JOINT_NAMES, Seen
from benchmarks.film.truths import read_joints
from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.io.npz_files import read_npz
from stcalib_ros.io.results import read_result

_SHUTTER_STEPS = 2
"""Steps from the row of a joint to the time when it was seen there: the second moves it by less
than 0.01 px."""
_HIDDEN = 0.2
"""Fraction of a person's joints that lie behind nearer people, from which they are not in clear
view. Chosen: an arm behind somebody is still a clear view, half a leg is not."""
_HEIGHT_OF_JOINTS = 0.9
"""Height of the joints of a standing person, from ankles to eyes, as a fraction of theirs."""
_PRESENT = 0.3
"""Score from which a joint of OpenPose is there."""


class Reference(Protocol):
    """Says who is in an image."""

    def seen(self, camera: str, stamp_s: float, image: int) -> Seen:
        """Return the people in an image, by its stamp or its number."""
        ...


class TrueReference:
    """The truth of our film, from the folder with its ``truth.yaml`` and ``truth.npz``."""

    def __init__(self, folder: Path) -> None:
        self._joints = read_joints(folder)
        self._cameras = {
            camera.name: camera for camera in read_result(folder / "truth.yaml").cameras
        }
        arrays = read_npz(folder / "truth.npz")
        names = [str(name) for name in arrays["camera_names"]]
        self._poses = {
            name: (arrays["R_cam_world"][k], arrays["t_cam_world"][k])
            for k, name in enumerate(names)
        }
        self._order = [self._joints.names.index(name) for name in JOINT_NAMES]

    def seen(self, camera: str, stamp_s: float, image: int) -> Seen:
        """Return the people in the image of a stamp; its number is not used."""
        del image
        one, (R, t) = self._cameras[camera], self._poses[camera]
        start = stamp_s + one.time_offset_s
        joints = self._joints(np.array([start]))[0]
        for _ in range(_SHUTTER_STEPS if one.line_time_s else 0):
            rows = project(joints @ R.T + t, one.intrinsics)[..., 1]
            times = start + one.line_time_s * np.clip(rows, 0, one.intrinsics.height)
            joints = self._each_at(times)
        in_camera = (joints @ R.T + t)[:, self._order]
        pixels = project(in_camera, one.intrinsics)
        size = np.array([one.intrinsics.width, one.intrinsics.height])
        inside = np.all((pixels >= 0) & (pixels <= size - 1), axis=-1)
        depth = in_camera[..., 2].mean(axis=1)
        stature = np.ptp(joints[..., 2], axis=1) / _HEIGHT_OF_JOINTS
        return Seen(
            np.where(inside[..., None], pixels, np.nan),
            one.intrinsics.K[1, 1] * stature / depth,
            inside.all(axis=1) & ~hidden(pixels, depth),
        )

    def _each_at(self, times: Float64Array) -> Float64Array:
        """Return the joints (P, J, 3), each at its own time (P, J)."""
        out = np.empty((*times.shape, 3))
        for person, joint in np.ndindex(times.shape):
            out[person, joint] = self._joints(times[person, joint])[person, joint]
        return out


class OpenPoseReference:
    """What OpenPose found in a film with the arrays of ``balance_single_openpose.npz``.

    Not a truth: its joints are some pixels off, and who was not found is not there.
    """

    def __init__(self, path: Path) -> None:
        self._arrays: dict[str, NDArray[Any]] = read_npz(path)
        names = [str(name) for name in self._arrays["kp_names"]]
        self._order = [names.index(name) for name in JOINT_NAMES]
        self._cameras = [str(name) for name in self._arrays["camera_names"]]

    def seen(self, camera: str, stamp_s: float, image: int) -> Seen:
        """Return the people in an image by its number; all of them count as in clear view."""
        del stamp_s
        arrays = self._arrays
        here = arrays["det_camera"] == self._cameras.index(camera)
        rows = np.flatnonzero(here & (arrays["det_frame"] == image))
        points = arrays["det_kp2d"][rows][:, self._order].astype(float)
        keypoints = np.where(points[..., 2:] >= _PRESENT, points[..., :2], np.nan)
        some = np.isfinite(keypoints).all(-1).sum(-1) > len(JOINT_NAMES) // 2
        keypoints = keypoints[some]
        heights = np.nanmax(keypoints[..., 1], axis=1) - np.nanmin(keypoints[..., 1], axis=1)
        return Seen(keypoints, heights / _HEIGHT_OF_JOINTS, np.ones(len(keypoints), dtype=bool))


def hidden(pixels: Float64Array, depth: Float64Array) -> BoolArray:
    """Return who (P,) has joints (P, J, 2) behind the outline of the joints of nearer people."""
    behind = np.zeros(pixels.shape[:2], dtype=bool)
    for near in range(len(pixels)):
        outline = cv2.convexHull(pixels[near].astype(np.float32))
        for far in np.flatnonzero(depth > depth[near]):
            for joint, point in enumerate(pixels[far]):
                inside = cv2.pointPolygonTest(outline, (float(point[0]), float(point[1])), False)
                behind[far, joint] |= inside >= 0
    return np.asarray(behind.mean(axis=1) > _HIDDEN)
