"""A message of another package over real DDS; visualization_msgs is part of ROS 2."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from bag_helpers import small_recording
from foreign_messages import kinect, seen_in_depth, write_foreign
from live import Client, LiveNode

from stcalib_ros.ros.convert import message_class

KIND = "visualization_msgs/msg/MarkerArray"


def test_bodies_as_markers_arrive_and_a_wrong_type_is_said(tmp_path):
    bag = write_foreign(
        tmp_path / "a.mcap",
        seen_in_depth(small_recording()),
        kind=KIND,
        topic="/{}/body_tracking_data",
        info_topic="/{}/depth/camera_info",
        make=kinect,
    )
    given = {"cameras": "[cam0, cam1, cam2]", "results_folder": str(tmp_path / "results")}
    for name in ("cam0", "cam1"):
        given[f"camera.{name}.pose_type"] = KIND
        given[f"camera.{name}.pose_topic"] = f"/{name}/body_tracking_data"
        given[f"camera.{name}.info_topic"] = f"/{name}/depth/camera_info"
    live, client = LiveNode(tmp_path, given, "foreign"), Client("foreign")
    try:
        client.play_completely(bag, {"cam0": 5, "cam1": 5})
        for name in ("cam0", "cam1"):
            status = client.status(f"camera {name}")
            assert (status["images_3d"], status["dropped"]) == ("5", "0")
        client.node.create_publisher(message_class(KIND), "/cam2/person_poses", 10)
        said = f"a stcalib_ros/msg/PersonPose3DArray; set pose_type of this camera to {KIND}"
        client.wait(lambda: said in client.status("camera cam2")["message"], "the type")
        assert live.stop()[0] == 0
    finally:
        live.kill()
        client.close()
