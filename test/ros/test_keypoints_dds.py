"""Cameras that send keypoints without 3D poses, over real DDS."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from live import Client, LiveNode
from stcalib_ros.msg import PersonPose3DArray
from stcalib_ros.srv import Recalibrate

from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.model.recording import keypoints_only
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.mocap import shipped_clips
from stcalib_ros.ros.convert import decode

POSES = "stcalib_ros/msg/PersonPose3DArray"


def test_keypoints_alone_give_the_numbers_of_the_bag_and_fractions_of_the_image_are_said(
    tmp_path: Path,
) -> None:
    options = SceneOptions(n_cameras=3, n_people=2, n_frames=240, seed=1)
    write_bag(keypoints_only(simulate(options, clips=shipped_clips()).recording), tmp_path / "bag")
    recording = read_bag(tmp_path / "bag")
    given = {
        "cameras": "[cam0, cam1, cam2]",
        "queue_depth": "1000",
        "auto_calibrate": "false",
        "results_folder": str(tmp_path / "results"),
    }
    live, client = LiveNode(tmp_path, given, "flat"), Client("flat")
    try:
        counts = {camera.name: len(camera.stamps) for camera in recording.cameras}
        client.play_completely(tmp_path / "bag", counts)
        for name in counts:
            status = client.status(f"camera {name}")
            assert (status["message"], status["images_3d"]) == ("receiving", "0")
            assert int(status["moving_s"]) > 2
        offline = calibrate(recording)
        assert offline.status is Status.OK
        result = client.answer(Recalibrate, "recalibrate", wait=True).result
        assert (result.status, result.message) == (int(offline.status), offline.message)
        for camera, extrinsics in zip(offline.cameras, result.extrinsics, strict=True):
            p = extrinsics.pose.pose.position
            np.testing.assert_allclose([p.x, p.y, p.z], camera.t_ref_cam, atol=1e-9)
        assert_fractions_are_said(client, tmp_path / "bag")
        assert live.stop()[0] == 0
    finally:
        live.kill()
        client.close()


def assert_fractions_are_said(client: Client, bag: Path) -> None:
    """Play another hour of the bag, with keypoints divided by the size of the image."""

    def later(raw):
        if not raw.topic.endswith("person_poses"):
            return None
        message: PersonPose3DArray = decode(POSES, raw.data)
        message.header.stamp.sec += 3600
        for person in message.persons:
            person.keypoints = np.array(person.keypoints) / 2000.0
        return message

    client.play(bag, sent=later)
    what = "sends on /cam0/person_poses: the keypoints look like fractions"
    client.wait(lambda: client.status("camera cam0")["message"].startswith(what), "a complaint")
