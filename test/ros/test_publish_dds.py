"""A finished result on the topics of the live node, by itself and as what the node starts with."""

from __future__ import annotations

import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from live import Client, LiveNode
from samples import calibration
from sensor_msgs.msg import CameraInfo
from stcalib_ros.msg import CalibrationResult, CameraExtrinsics, TimeOffset
from visualization_msgs.msg import MarkerArray

from stcalib_ros.core.model.calibration import Status
from stcalib_ros.io.results import read_result, write_result
from stcalib_ros.ros.publish import main

CALIBRATION = calibration()
NAMES = [camera.name for camera in CALIBRATION.cameras]


@pytest.fixture
def result(tmp_path: Path) -> Path:
    path = tmp_path / "walk.yaml"
    write_result(CALIBRATION, path)
    return path


def test_a_result_is_published_and_is_what_the_live_node_starts_with(
    tmp_path: Path, result: Path
) -> None:
    given = {
        "cameras": f"[{', '.join(NAMES)}]",
        "results_folder": str(tmp_path / "results"),
        "initial_calibration": str(result),
    }
    published = LiveNode(tmp_path, {}, "publish", executable="publish", arguments=[result])
    started = LiveNode(tmp_path, given, "started")
    clients = [Client("publish"), Client("started")]
    try:
        for client in clients:
            (message,) = client.latched(CalibrationResult, "result", 1)
            assert (message.run_id, message.status) == ("file-walk", int(Status.OK))
            assert message.header.stamp == message.window_end
            extrinsics = client.latched(CameraExtrinsics, "extrinsics", 3)
            for one, camera in zip(extrinsics, CALIBRATION.cameras, strict=True):
                p = one.pose.pose.position
                np.testing.assert_allclose([p.x, p.y, p.z], camera.t_ref_cam, atol=1e-9)
            offsets = client.latched(TimeOffset, "time_offsets", 3)
            assert [o.offset_s for o in offsets] == [c.time_offset_s for c in CALIBRATION.cameras]
            (markers,) = client.latched(MarkerArray, "markers", 1)
            assert [m.text for m in markers.markers if m.ns == "names"] == NAMES
        for camera in CALIBRATION.cameras:
            (info,) = clients[0].latched(CameraInfo, f"{camera.name}/camera_info", 1)
            assert info.header.frame_id == camera.frame_id
            assert info.k.tolist() == camera.intrinsics.K.ravel().tolist()
        assert published.stop(signal.SIGINT)[0] == started.stop()[0] == 0
        assert "Traceback" not in published.log.read_text() + started.log.read_text()
        saved = read_result(tmp_path / "results" / "calibration.000001.yaml")
        assert saved.window_s == CALIBRATION.window_s
    finally:
        published.kill()
        started.kill()
        for client in clients:
            client.close()


def test_what_is_not_to_be_used_is_not_published(
    result: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_result(replace(CALIBRATION, status=Status.DEGENERATE), result)
    for path, status, why in (
        (result, 3, "is not to be used (DEGENERATE)"),
        (result / "no", 2, "Not a directory"),
    ):
        monkeypatch.setattr("sys.argv", ["publish", str(path), "--ros-args", "-r", "__node:=a"])
        assert main() == status
        (said,) = capsys.readouterr().err.splitlines()
        assert said.startswith("publish: ")
        assert why in said
