"""Skeletons of Hi-ROS: markers by their names, in metres or pixels, at the time of the image."""

from __future__ import annotations

import numpy as np
import pytest
from bag_helpers import CAMERA_INFO, START_NS, header, info, small_recording, write_bag
from foreign_messages import Seen, assert_read, hiros, hiros_skeleton, seen_in_depth, write_foreign

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.message_types.hiros_skeletons import JOINTS

KIND = "hiros_skeleton_msgs/msg/SkeletonGroup"


def written(path, given, n_axes: int):
    topics = {"topic": "/{}/skeletons", "info_topic": "/{}/camera_info"}
    return write_foreign(path, given, kind=KIND, make=hiros(n_axes), **topics)


def bag_of(tmp_path, *skeletons):
    return write_bag(
        tmp_path / "a.mcap",
        [
            ("/a/camera_info", CAMERA_INFO, info(), START_NS),
            (
                "/a/skeletons",
                KIND,
                {"header": header(START_NS), "skeletons": [*skeletons]},
                START_NS,
            ),
        ],
    )


def skeleton(*names: str, **changes):
    seen = Seen(3, {}, {name: np.array([0.0, 0.0, 2.0]) for name in names})
    return hiros_skeleton(header(START_NS), seen, 3, named=str) | changes


def test_metres_are_seen_by_the_lens(tmp_path):
    given = seen_in_depth(small_recording())
    bag = written(tmp_path / "a.mcap", given, 3)
    assert_read(bag, given, joint_names=JOINTS, metric=True, exact=False)


def test_markers_without_z_are_pixels(tmp_path):
    given = small_recording()
    bag = written(tmp_path / "a.mcap", given, 2)
    assert_read(bag, given, joint_names=JOINTS, has_3d_poses=False)


@pytest.mark.parametrize(
    ("name", "joint"),
    [("KNEE_LEFT", "left_knee"), ("LeftKnee", "left_knee"), ("Spine Navel", "navel")],
)
def test_names_are_known_however_they_are_written(tmp_path, name, joint):
    (camera,) = read_bag(bag_of(tmp_path, skeleton(name, "no joint"))).cameras
    (track,) = camera.tracks
    (known,) = np.flatnonzero(np.isfinite(track.keypoints[0]).all(-1))
    assert (track.track_id, JOINTS[known]) == (3, joint)


@pytest.mark.parametrize(
    ("skeletons", "said"),
    [
        ([skeleton("m1", "m2")], "markers named 'm1', 'm2', none of which is a joint of ours"),
        ([skeleton("nose", src_frame="other")], "frame 'cam0_optical_frame' and not in that of"),
        ([skeleton("nose"), skeleton("nose", src_frame="b")], "skeletons of 2 images in one"),
    ],
)
def test_what_cannot_be_used_is_said(tmp_path, skeletons, said):
    with pytest.raises(InputError, match=said):
        read_bag(bag_of(tmp_path, *skeletons))
