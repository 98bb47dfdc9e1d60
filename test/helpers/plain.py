"""Messages as the buffers take them, without ROS, and a listener of the buffers."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np

from stcalib_ros.io.topics import SelectedCamera
from stcalib_ros.ros.buffers import Buffers

CAMERA = SelectedCamera("cam0", "/cam0/person_poses", "/cam0/camera_info", None)
STEP_S = 0.1


def poses(
    stamp_s: float,
    *,
    x: float = 100.0,
    persons: int = 1,
    joints: Sequence[float] = (1.0,) * 51,
    keypoints: Sequence[float] | None = None,
    **fields: object,
) -> object:
    """Persons 170 px high, at `x`."""
    if keypoints is None:
        keypoints = np.stack([np.full(17, x), np.linspace(100, 270, 17)], axis=1).ravel()
    person = {"score": 1.0, "joints": joints, "keypoints": keypoints, "joint_scores": []}
    ns = round(stamp_s * 1e9)
    stamp = SimpleNamespace(sec=ns // 10**9, nanosec=ns % 10**9)
    message = {
        "header": SimpleNamespace(stamp=stamp, frame_id="cam0_optical_frame"),
        "layout": "h36m_17",
        "joint_names": [],
        "rectified": False,
        "metric": True,
        "persons": [SimpleNamespace(track_id=i, **person) for i in range(persons)],
    }
    return SimpleNamespace(**message | fields)


def info(**fields: object) -> object:
    message = {
        "width": 640,
        "height": 480,
        "distortion_model": "plumb_bob",
        "d": [0.0] * 5,
        "k": [600.0, 0.0, 320.0, 0.0, 600.0, 240.0, 0.0, 0.0, 1.0],
        "r": [0.0] * 9,
        "p": [0.0] * 12,
        "binning_x": 0,
        "binning_y": 0,
        "roi": SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0),
    }
    return SimpleNamespace(**message | fields)


class Ear:
    def __init__(self) -> None:
        self.lines: list[str] = []

    def __call__(self, _name: str, line: str) -> None:
        self.lines.append(line)


def fill(
    buffers: Buffers,
    start_s: float,
    seconds: float,
    *,
    speed_px_s: float = 0.0,
    **fields: object,
) -> None:
    for t in np.arange(0.0, seconds, STEP_S):
        x = 100.0 + speed_px_s * t
        buffers.add_poses("cam0", poses(start_s + t, x=x, **fields))  # type: ignore[arg-type]
