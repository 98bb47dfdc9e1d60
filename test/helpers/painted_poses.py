"""A stand-in for a pose estimator: it finds the poses that are written into the pixels."""

from __future__ import annotations

import time

import numpy as np

from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.estimation.poses import ImagePoses

LAYOUT = LAYOUTS["h36m_17"]
HEIGHT, WIDTH = 24, 32
SLOW_S = 0.2


def painted(keypoints) -> np.ndarray:
    """An image (24, 32, 3) with the poses (P, 17, 2) in it."""
    values = np.asarray(keypoints, dtype=np.float32).reshape(-1, 17, 2)
    image = np.zeros(HEIGHT * WIDTH * 3, dtype=np.uint8)
    image[0] = len(values)
    written = np.frombuffer(values.tobytes(), dtype=np.uint8)
    image[1 : 1 + len(written)] = written
    return image.reshape(HEIGHT, WIDTH, 3)


class PaintedPoses:
    """Reads `painted` images; those of another size show nobody."""

    layout = LAYOUT

    def __init__(self, sleep_s: float = 0.0) -> None:
        self._sleep_s = sleep_s

    def poses(self, image: np.ndarray) -> ImagePoses:
        time.sleep(self._sleep_s)
        n = int(image.flat[0]) if image.shape == (HEIGHT, WIDTH, 3) else 0
        written = image.ravel()[1 : 1 + n * 136].tobytes()
        keypoints = np.frombuffer(written, dtype=np.float32).reshape(n, 17, 2).astype(np.float64)
        known = np.isfinite(keypoints[..., 0])
        return ImagePoses(keypoints, 1.0 * known, np.full((n, 17, 3), np.nan))


def slow() -> PaintedPoses:
    return PaintedPoses(SLOW_S)


def nothing() -> str:
    return "no estimator"
