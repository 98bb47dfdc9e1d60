"""Bodies as markers: joints in the frame of the depth camera, keypoints by its lens."""

from __future__ import annotations

import numpy as np
import pytest
from bag_helpers import (
    CAMERA_INFO,
    START_NS,
    header,
    info,
    schema_text,
    small_recording,
    write_bag,
)
from foreign_messages import (
    KINECT,
    assert_read,
    joint_marker,
    kinect,
    seen_in_depth,
    write_foreign,
)

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.messages import fields_of_lens
from stcalib_ros.io.topics import CameraSelection

KIND = "visualization_msgs/msg/MarkerArray"
STAMPED = header(START_NS)


def bag_of(tmp_path, *markers, schemas=None, topic="/a/body_tracking_data", **changes):
    return write_bag(
        tmp_path / "a.mcap",
        [
            ("/a/depth/camera_info", CAMERA_INFO, info(**changes), START_NS),
            ("/a/rgb/camera_info", CAMERA_INFO, info(width=9), START_NS),
            *((topic, KIND, {"markers": some}, START_NS) for some in markers),
        ],
        schemas=schemas,
    )


def test_what_is_published_is_read(tmp_path):
    given = seen_in_depth(small_recording())
    bag = write_foreign(
        tmp_path / "a.mcap",
        given,
        kind=KIND,
        topic="/{}/body_tracking_data",
        info_topic="/{}/depth/camera_info",
        make=kinect,
    )
    assert_read(bag, given, joint_names=KINECT, metric=True, exact=False)


def test_the_lens_is_that_of_the_depth_camera_and_images_without_a_body_are_nothing(tmp_path):
    marker = joint_marker(STAMPED, 504, (0.0, 0.0, 2.0))
    (camera,) = read_bag(bag_of(tmp_path, [marker], [], [], [])).cameras
    assert (camera.name, camera.intrinsics.width, len(camera.stamps)) == ("a", 640, 1)
    (track,) = camera.tracks
    assert track.track_id == 5
    assert track.keypoints[0, KINECT.index("left_collar")].tolist() == [320.0, 240.0]


def test_other_markers_are_no_joints(tmp_path):
    joint = joint_marker(STAMPED, 504, (0.0, 0.0, 2.0))
    text, gone = joint | {"type": 9, "id": 599}, joint | {"action": 2, "id": 505}
    (camera,) = read_bag(bag_of(tmp_path, [text, joint, gone])).cameras
    assert sum(int(t.keypoints[..., 0].size) for t in camera.tracks) == len(KINECT)
    with pytest.raises(InputError, match=r"marker 532: expected 100 \* body \+ joint"):
        read_bag(bag_of(tmp_path, [joint | {"id": 532}]))
    with pytest.raises(InputError, match="no topic of type"):
        read_bag(bag_of(tmp_path, [joint], topic="/a/obstacles"))


def test_without_a_lens_there_are_no_keypoints(tmp_path):
    bag = bag_of(tmp_path, [joint_marker(STAMPED, 504, (0.0, 0.0, 2.0))], k=[0.0] * 9)
    with pytest.raises(InputError, match="/a/depth/camera_info: the poses have no keypoints"):
        read_bag(bag)


def test_a_lens_that_is_given_beside_the_bag_projects(tmp_path):
    bag = bag_of(tmp_path, [joint_marker(STAMPED, 504, (1.0, 0.0, 2.0))], k=[0.0] * 9)
    K = np.array([[500.0, 0.0, 300.0], [0.0, 500.0, 200.0], [0.0, 0.0, 1.0]])
    given = fields_of_lens(Intrinsics(640, 480, LensModel.PLUMB_BOB, K, np.zeros(5)))
    selection = CameraSelection().with_lens("a", info=given)
    (track,) = read_bag(bag, selection=selection).cameras[0].tracks
    assert track.keypoints[0, KINECT.index("left_collar")].tolist() == [550.0, 200.0]


def test_constants_differ_between_releases_and_change_no_message(tmp_path):
    texts = {KIND: schema_text(KIND).replace("string ns", "int32 ARROW_STRIP=12\nstring ns")}
    marker = joint_marker(STAMPED, 504, (0.0, 0.0, 2.0))
    assert len(read_bag(bag_of(tmp_path, [marker], schemas=texts)).cameras) == 1
