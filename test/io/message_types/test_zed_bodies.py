"""Bodies of the ZED wrapper: three formats, a frame that is not optical, states of the tracker."""

from __future__ import annotations

from dataclasses import replace

import pytest
from bag_helpers import small_recording
from foreign_messages import ZED_FORMATS, assert_read, write_foreign, zed

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.bag import open_bag, read_bag
from stcalib_ros.io.bag_source import raw_messages
from stcalib_ros.io.message_types import decode
from stcalib_ros.io.message_types.zed_bodies import JOINTS

KIND = "zed_msgs/msg/ObjectsStamped"
TOPICS = {
    "topic": "/{}/zed_node/body_trk/skeletons",
    "info_topic": "/{}/zed_node/left/color/rect/camera_info",
}


def bag_of(tmp_path, make, *, kind=KIND, **topics):
    given = small_recording()
    cameras = [replace(c, frame_id=f"{c.name}_left_camera_frame_optical") for c in given.cameras]
    given = replace(given, cameras=tuple(cameras))
    topics = TOPICS | topics
    return given, write_foreign(tmp_path / "a.mcap", given, kind=kind, make=make, **topics)


@pytest.mark.parametrize("body_format", [0, 1, 2])
@pytest.mark.parametrize("kind", [KIND, "zed_interfaces/msg/ObjectsStamped"])
def test_what_is_published_is_read(tmp_path, kind, body_format):
    given, bag = bag_of(tmp_path, zed(body_format), kind=kind)
    assert_read(
        bag,
        given,
        joint_names=JOINTS,
        sent=ZED_FORMATS[body_format],
        metric=True,
        has_3d_poses=True,
    )


@pytest.mark.parametrize(
    ("changes", "n_tracks"),
    [
        ({"tracking_state": 0}, 7),
        ({"tracking_available": False}, 7),
        ({"tracking_state": 2}, 0),
        ({"tracking_state": 3}, 0),
        ({"skeleton_available": False}, 0),
    ],
)
def test_only_bodies_that_were_seen_and_only_ids_that_are_some(tmp_path, changes, n_tracks):
    _, bag = bag_of(tmp_path, zed(2, **changes))  # seven persons in five images
    tracks = read_bag(bag).cameras[0].tracks
    assert len(tracks) == n_tracks
    assert all(len(track.frames) == 1 for track in tracks)


def test_unknown_format(tmp_path):
    _, bag = bag_of(tmp_path, zed(2, body_format=3))
    with pytest.raises(InputError, match=r"body format 3: known are 0, 1 and 2 \(BODY_18"):
        read_bag(bag)


def test_objects_of_the_same_type_are_no_people(tmp_path):
    _, bag = bag_of(tmp_path, zed(2), topic="/{}/zed_node/obj_det/objects")
    with pytest.raises(InputError, match=r"no topic of type .*/obj_det/objects \(zed_msgs"):
        read_bag(bag)


def test_the_score_is_a_fraction(tmp_path):
    _, bag = bag_of(tmp_path, zed(2, confidence=99.0))
    files, cameras = open_bag(bag)
    (first, *_) = raw_messages(files, frozenset([cameras[0].pose_topic]))
    assert {p.score for p in decode(KIND, first.data).persons} == {1.0}
