"""Which camera a topic belongs to, and which topics serve it."""

from __future__ import annotations

import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.topic_names import camera_name
from stcalib_ros.io.topics import CameraSelection, CameraTopics, select_cameras

OURS, INFO = "stcalib_ros/msg/PersonPose3DArray", "sensor_msgs/msg/CameraInfo"
YOLO = "yolo_msgs/msg/DetectionArray"


def chosen(topics: dict[str, str]) -> list[tuple[str, str, str]]:
    cameras = select_cameras(topics, CameraSelection())
    return [(c.name, c.pose_topic, c.info_topic) for c in cameras]


@pytest.mark.parametrize(
    ("topic", "kind", "name"),
    [
        ("/cam0/person_poses", OURS, "cam0"),
        ("/site/cam0/person_poses", OURS, "site/cam0"),
        ("/person_poses", OURS, "person_poses"),
        ("/cam0/yolo/tracking", YOLO, "cam0"),
        ("/yolo0/tracking", YOLO, "yolo0"),
        ("/yolo/tracking", YOLO, "yolo"),
        ("/cam0/humans/bodies/xyz/skeleton2d", "hri_msgs/msg/Skeleton2D", "cam0"),
        ("/cam0/yolo/person_poses", OURS, "cam0/yolo"),
    ],
)
def test_name_is_the_namespace_without_that_of_the_node(topic: str, kind: str, name: str) -> None:
    assert camera_name(topic, kind) == name


def test_of_one_camera_tracked_detections_are_read_and_our_message_before_all() -> None:
    topics = {"/a/yolo/detections": YOLO, "/a/camera_info": INFO}
    assert chosen(topics) == [("a", "/a/yolo/detections", "/a/camera_info")]
    topics |= {"/a/yolo/tracking": YOLO, "/a/yolo/detections_3d": YOLO}
    assert chosen(topics) == [("a", "/a/yolo/tracking", "/a/camera_info")]
    topics |= {"/a/person_poses": OURS}
    assert chosen(topics) == [("a", "/a/person_poses", "/a/camera_info")]


def test_a_camera_with_a_name_of_its_own_is_one_camera() -> None:
    topics = {"/a/yolo/detections": YOLO, "/a/yolo/tracking": YOLO, "/a/camera_info": INFO}
    topics |= {"/b/yolo/tracking": YOLO, "/b/camera_info": INFO}
    selection = CameraSelection(None, {"left": CameraTopics("/a/yolo/tracking")})
    assert [c.name for c in select_cameras(topics, selection)] == ["b", "left"]


def test_two_that_are_alike_are_not_guessed() -> None:
    topics = {"/a/yolo/one": YOLO, "/a/yolo/two": YOLO, "/a/camera_info": INFO}
    with pytest.raises(
        InputError, match="two cameras have the same name, 'a': /a/yolo/one and /a/yolo"
    ):
        chosen(topics)


def test_lens_is_the_nearest_within_the_camera() -> None:
    topics = {"/a/yolo/tracking": YOLO, "/a/color/camera_info": INFO, "/b/camera_info": INFO}
    assert chosen(topics)[0][2] == "/a/color/camera_info"
    topics |= {"/a/depth/camera_info": INFO}
    assert chosen(topics)[0][2] == "/a/color/camera_info"
    topics |= {"/a/camera_info": INFO, "/a/yolo/camera_info": INFO}
    assert chosen(topics)[0][2] == "/a/yolo/camera_info"


@pytest.mark.parametrize("others", [(), ("/site/b/camera_info",), ("/site/a/x/i", "/site/a/y/i")])
def test_the_lens_of_another_camera_and_one_of_several_are_not_guessed(others) -> None:
    topics = {"/site/a/yolo/tracking": YOLO} | dict.fromkeys(others, INFO)
    said = (
        r"camera site/a: no CameraInfo on /site/a/yolo/camera_info: there is no such topic; .*"
        r"name its topic with camera\.site/a\.info_topic"
    )
    with pytest.raises(InputError, match=said):
        chosen(topics)
