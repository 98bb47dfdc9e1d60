"""Skeletons of ROS4HRI: a topic a person, fractions of the image."""

from __future__ import annotations

from bag_helpers import CAMERA_INFO, START_NS, header, info, small_recording, write_bag
from foreign_messages import HRI, assert_read, hri, write_foreign

from stcalib_ros.io.bag import read_bag

KIND = "hri_msgs/msg/Skeleton2D"


def test_what_is_published_is_read(tmp_path):
    given = small_recording()
    bag = write_foreign(
        tmp_path / "a.mcap",
        given,
        kind=KIND,
        topic="/{}/humans/bodies/{id}/skeleton2d",
        info_topic="/{}/color/camera_info",
        make=hri,
    )
    found = assert_read(bag, given, joint_names=HRI, has_3d_poses=False, exact=False)
    assert [len(c.tracks) for c in found.cameras] == [2, 2]


def test_ids_are_text_and_one_image_has_all_people(tmp_path):
    nowhere = {"x": 0.0, "y": 0.0, "c": 0.0}
    seen = [{"x": 0.5, "y": 0.25, "c": 0.8}, *[nowhere] * 17]
    messages = [("/room/camera_info", CAMERA_INFO, info(), START_NS)]
    for person in ("abcde", "fghij"):
        topic = f"/room/humans/bodies/{person}/skeleton2d"
        messages.append((topic, KIND, {"header": header(START_NS), "skeleton": seen}, START_NS))
    said: list[str] = []
    (camera,) = read_bag(write_bag(tmp_path / "a.mcap", messages), warn=said.append).cameras
    assert (camera.name, len(camera.stamps), len(camera.tracks), said) == ("room", 1, 2, [])
    for track in camera.tracks:
        assert track.keypoints[0, 0].tolist() == [319.5, 119.5]
        assert (track.scores[0, 1:] == 0).all()
