"""RTMPose and RTMO, run by rtmlib, which fetches their weights itself where there is a network."""

from __future__ import annotations

import sys
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import FloatArray
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS, Layout
from stcalib_ros.estimation.poses import ImagePoses, UInt8Array
from stcalib_ros.estimation.runtime import onnx_session, require_package

_EXTRA = "rtmlib"
_MODE = "balanced"


@dataclass(frozen=True, slots=True)
class RtmlibModel:
    """One of rtmlib's ways to find persons.

    Attributes
    ----------
    pose : str
        Name of its network of poses, a file in the folder of weights.
    detector : str or None
        That of the network that finds persons for it; None: the network of poses does.
    """

    pose: str
    detector: str | None


RTMO = RtmlibModel("rtmo.onnx", None)
"""One network for all persons: the cost does not depend on their number."""

RTMPOSE = RtmlibModel("rtmpose.onnx", "rtmpose-detector.onnx")
"""YOLOX finds the persons, and RTMPose the joints of each."""


class RtmlibEstimator:
    """Runs networks by rtmlib: those in the folder of weights, else those that it fetches.

    Parameters
    ----------
    model : RtmlibModel
    folder : Path
        Folder of the weights.
    threads : int
        Threads of one image.

    Raises
    ------
    InputError
        rtmlib is not installed, its weights cannot be fetched, or a file is no such network.
    """

    def __init__(self, model: RtmlibModel, folder: Path, threads: int) -> None:
        rtmlib = require_package("rtmlib", _EXTRA)
        known = (rtmlib.Body.MODE if model.detector else rtmlib.Body.RTMO_MODE)[_MODE]
        self._detector = None
        if model.detector is not None:
            path = folder / model.detector
            self._detector = _tool(
                rtmlib.YOLOX, path, known["det"], known["det_input_size"], threads
            )
        kind = rtmlib.RTMPose if model.detector else rtmlib.RTMO
        path = folder / model.pose
        self._pose = _tool(kind, path, known["pose"], known["pose_input_size"], threads)

    @property
    def layout(self) -> Layout:
        """COCO's 17 joints."""
        return LAYOUTS["coco_17"]

    def poses(self, image: UInt8Array) -> ImagePoses:
        """Return the persons in an image (blue, green, red); in 2D alone."""
        if self._detector is None:
            keypoints, scores = self._pose(image)
        elif len(boxes := self._detector(image)):  # of none, it would take the whole image
            keypoints, scores = self._pose(image, bboxes=boxes)
        else:
            keypoints, scores = np.empty((0, 0)), np.empty(0)
        return _image_poses(np.asarray(keypoints), np.asarray(scores), self.layout.n_joints)


def _image_poses(keypoints: FloatArray, scores: FloatArray, n_joints: int) -> ImagePoses:
    keypoints = keypoints.astype(np.float64).reshape(-1, n_joints, 2)
    scores = np.clip(scores.astype(np.float64).reshape(-1, n_joints), 0.0, 1.0)
    persons = scores.any(axis=1)  # RTMO's way to say that there is none is one of zeros
    joints = np.full((int(persons.sum()), n_joints, 3), np.nan)
    return ImagePoses(keypoints[persons], scores[persons], joints)


def _tool(kind: Any, path: Path, source: str, size: tuple[int, int], threads: int) -> Any:
    """Load a network; by rtmlib's own session it would take all cores."""
    where = str(path) if path.is_file() else source
    try:
        with redirect_stdout(sys.stderr):  # it says what it loads
            tool = kind(where, model_input_size=size, backend="onnxruntime")
    except Exception as error:  # of downloads and of ONNX Runtime, which have no common base
        raise InputError(
            f"rtmlib cannot load {where} ({error}): without a network, put that file, as it "
            f"unpacks to .onnx, at {path}"
        ) from error
    tool.session = onnx_session(Path(tool.onnx_model), threads, _EXTRA)
    return tool
