"""Small recordings, and bags written by an encoder that is not ours."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as RawWriter
from mcap_ros2.writer import Writer

from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.core.model.recording import (
    CameraRecording,
    Intrinsics,
    LensModel,
    Recording,
    Track,
)
from stcalib_ros.io.message_types import CAMERA_INFO as CAMERA_INFO_TYPE
from stcalib_ros.io.message_types import PERSON_POSES, TYPES

POSES, CAMERA_INFO = PERSON_POSES.name, CAMERA_INFO_TYPE.name

START_NS = 1_760_000_000_000_000_000
LAYOUT = LAYOUTS["h36m_17"]

Message = tuple[str, str, dict[str, Any], int]


def schema_text(type_name: str) -> str:
    """Definition of one of the types that we read, as bags carry it."""
    return TYPES[type_name].schema_text()


def small_recording(n_cameras: int = 2, n_frames: int = 5, *, rectified: bool = False) -> Recording:
    """Two tracks per camera, one with a gap; values that float32 holds; whole nanoseconds."""
    rng = np.random.default_rng(3)

    def track(track_id: int, frames: list[int]) -> Track:
        n, J = len(frames), LAYOUT.n_joints
        keypoints = rng.normal(500, 100, (n, J, 2)).astype(np.float32).astype(float)
        keypoints[0, 3] = np.nan
        joints = rng.normal(size=(n, J, 3)).astype(np.float32).astype(float)
        joints[-1, 5] = np.nan
        scores = rng.uniform(size=(n, J)).astype(np.float32).astype(float)
        return Track(track_id, np.array(frames), keypoints, joints, scores)

    K = np.array([[800.0, 0, 320], [0, 810, 240], [0, 0, 1]])
    turned = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    D = np.zeros(0) if rectified else np.array([0.1, -0.2, 0.001, 0.002, 0.05])
    cameras = tuple(
        CameraRecording(
            name=f"cam{c}",
            frame_id=f"cam{c}_optical_frame",
            intrinsics=Intrinsics(
                640, 480, LensModel.PLUMB_BOB, K, D, turned if rectified else np.eye(3)
            ),
            layout=LAYOUT,
            stamps=(123_456_789 * (c + 1) + 33_333_333 * np.arange(n_frames)) / 1e9,
            tracks=(track(3, list(range(n_frames))), track(7, [0, n_frames - 1])),
            metric=True,
        )
        for c in range(n_cameras)
    )
    return Recording(cameras, START_NS)


def assert_same(a: Recording, b: Recording) -> None:
    """Every number is the same."""
    assert a.epoch_ns == b.epoch_ns
    assert [c.name for c in a.cameras] == [c.name for c in b.cameras]
    for x, y in zip(a.cameras, b.cameras, strict=True):
        assert (x.frame_id, x.layout, x.metric) == (y.frame_id, y.layout, y.metric)
        assert (x.intrinsics.width, x.intrinsics.height) == (
            y.intrinsics.width,
            y.intrinsics.height,
        )
        assert x.intrinsics.model is y.intrinsics.model
        for name in ("K", "D", "R_rect_cam"):
            np.testing.assert_array_equal(getattr(x.intrinsics, name), getattr(y.intrinsics, name))
        np.testing.assert_array_equal(x.stamps, y.stamps)
        assert [t.track_id for t in x.tracks] == [t.track_id for t in y.tracks]
        for s, t in zip(x.tracks, y.tracks, strict=True):
            for name in ("frames", "keypoints", "joints", "scores"):
                np.testing.assert_array_equal(getattr(s, name), getattr(t, name))


def header(stamp_ns: int, frame_id: str = "cam0_optical_frame") -> dict[str, Any]:
    return {
        "stamp": {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9},
        "frame_id": frame_id,
    }


def person(track_id: int = 1, *, score: float = 0.5, **changes: Any) -> dict[str, Any]:
    J = LAYOUT.n_joints
    return {
        "track_id": track_id,
        "score": score,
        "joints": [float(i) for i in range(3 * J)],
        "keypoints": [100.0 + i for i in range(2 * J)],
        "joint_scores": [0.5] * J,
    } | changes


def poses(k: int, persons: list[dict[str, Any]] | None = None, **changes: Any) -> dict[str, Any]:
    """Message of the k-th image at 10 Hz."""
    return {
        "header": header(START_NS + k * 10**8),
        "layout": "h36m_17",
        "joint_names": [],
        "rectified": False,
        "metric": True,
        "persons": [person()] if persons is None else persons,
    } | changes


def info(**changes: Any) -> dict[str, Any]:
    return {
        "header": header(START_NS),
        "height": 480,
        "width": 640,
        "distortion_model": "plumb_bob",
        "d": [0.0] * 5,
        "k": [800.0, 0, 320, 0, 800, 240, 0, 0, 1],
        "r": [1.0, 0, 0, 0, 1, 0, 0, 0, 1],
        "p": [800.0, 0, 320, 0, 0, 800, 240, 0, 0, 0, 1, 0],
        "binning_x": 0,
        "binning_y": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
    } | changes


def camera(name: str = "cam0", images: Iterable[dict[str, Any]] | None = None) -> list[Message]:
    """A CameraInfo and images of one camera, three unless given."""
    images = [poses(k) for k in range(3)] if images is None else list(images)
    return [
        (f"/{name}/camera_info", CAMERA_INFO, info(), START_NS),
        *((f"/{name}/person_poses", POSES, m, START_NS + i) for i, m in enumerate(images)),
    ]


def write_bag(
    path: Path,
    messages: Iterable[Message],
    *,
    schemas: dict[str, str] | None = None,
    compression: CompressionType = CompressionType.ZSTD,
    chunk_size: int = 1024 * 1024,
) -> Path:
    """Write messages with the encoder of mcap-ros2-support."""
    texts = {"std_msgs/msg/String": "string data\n"} | (schemas or {})
    with path.open("wb") as stream:
        writer = Writer(stream, compression=compression, chunk_size=chunk_size)
        known: dict[str, Any] = {}
        for topic, kind, message, log_time in messages:
            if kind not in known:
                text = texts.get(kind) or schema_text(kind)
                known[kind] = writer.register_msgdef(kind, text)
            writer.write_message(topic, known[kind], message, log_time=log_time)
        writer.finish()
    return path


def write_raw(
    path: Path,
    topics: Iterable[tuple[str, str, str, bytes | None]],
    *,
    encodings: tuple[str, str] = ("cdr", "ros2msg"),
) -> Path:
    """Write topics (name, type, definition, data of the only message if any) byte by byte."""
    with path.open("wb") as stream:
        writer = RawWriter(stream)
        writer.start(profile="ros2", library="test")
        for topic, kind, text, data in topics:
            schema = writer.register_schema(kind, encodings[1], text.encode())
            channel = writer.register_channel(topic, encodings[0], schema)
            if data is not None:
                writer.add_message(channel, START_NS, data, 0)
        writer.finish()
    return path
