"""What holds for the messages of every package, whole, cut off, or without a definition."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from bag_helpers import assert_same, small_recording, write_raw
from foreign_messages import hiros, hri, kinect, write_foreign, yolo, zed

from stcalib_ros.io.assemble import assemble_recording
from stcalib_ros.io.bag import open_bag, read_bag
from stcalib_ros.io.bag_source import raw_messages, topic_schemas
from stcalib_ros.io.message_types import TYPES, Content, decode, decode_whole
from stcalib_ros.ros.buffers import Buffers
from stcalib_ros.ros.intake import Intake
from stcalib_ros.ros.load import Meter
from stcalib_ros.ros.streams import Limits

MAKERS = {
    "yolo_msgs/msg/DetectionArray": ("/{}/yolo/tracking", yolo),
    "yolov8_msgs/msg/DetectionArray": ("/{}/yolo/tracking", yolo),
    "zed_msgs/msg/ObjectsStamped": ("/{}/zed_node/body_trk/skeletons", zed(2)),
    "zed_interfaces/msg/ObjectsStamped": ("/{}/zed_node/body_trk/skeletons", zed(0)),
    "visualization_msgs/msg/MarkerArray": ("/{}/body_tracking_data", kinect),
    "hiros_skeleton_msgs/msg/SkeletonGroup": ("/{}/skeletons", hiros(3)),
    "hri_msgs/msg/Skeleton2D": ("/{}/humans/bodies/{id}/skeleton2d", hri),
}
KINDS = pytest.mark.parametrize("kind", MAKERS)


@pytest.fixture
def bag_of(tmp_path):
    def make(kind: str):
        topic, maker = MAKERS[kind]
        return write_foreign(
            tmp_path / "a.mcap",
            small_recording(n_cameras=1),
            kind=kind,
            topic=topic,
            info_topic="/{}/camera_info",
            make=maker,
        )

    return make


def messages(bag) -> list[bytes]:
    files, cameras = open_bag(bag)
    topics = frozenset(camera.pose_topic for camera in cameras)
    return [raw.data for raw in raw_messages(files, topics)]


def test_all_of_them_are_here():
    poses = {name for name, known in TYPES.items() if known.content is Content.POSES}
    assert {*MAKERS, "stcalib_ros/msg/PersonPose3DArray"} == poses


@KINDS
def test_every_byte_is_accounted_for(bag_of, kind):
    given = messages(bag_of(kind))
    assert len(given) == 5
    assert all(decode_whole(kind, data).persons for data in given)


@KINDS
def test_a_message_that_ends_early_is_refused(bag_of, kind):
    whole = messages(bag_of(kind))[0]
    for length in np.linspace(0, len(whole) - 8, 40).astype(int):
        with pytest.raises((ValueError, struct.error)):
            decode(kind, whole[:length])


@KINDS
@pytest.mark.filterwarnings("ignore:invalid value encountered in cast")
def test_changed_bytes_give_no_other_error(bag_of, kind):
    whole, rng = messages(bag_of(kind))[0], np.random.default_rng(5)
    for _ in range(60):
        data = bytearray(whole)
        for at in rng.integers(4, len(data), 4):
            data[at] = rng.integers(256)
        try:
            decode(kind, bytes(data))
        except (ValueError, struct.error):
            continue


@pytest.mark.parametrize("kind", [k for k in MAKERS if not TYPES[k].topic_per_person])
def test_it_is_received_live_as_it_is_read(bag_of, kind):
    bag = bag_of(kind)
    files, cameras = open_bag(bag)
    buffers = Buffers(cameras, Limits(), lambda _about, line: pytest.fail(line))
    intake = Intake(cameras, buffers, Meter())
    takes = {cameras[0].info_topic: intake.info_of(cameras[0])}
    takes[cameras[0].pose_topic] = intake.poses_of(cameras[0])
    for number, raw in enumerate(raw_messages(files, frozenset(takes))):
        about = {"publication_sequence_number": number, "received_timestamp": raw.log_time}
        takes[raw.topic](raw.data, about)
    assert np.isfinite(buffers.snapshot()[0].images[0].keypoints).any()
    assert_same(assemble_recording(buffers.snapshot(), warn=pytest.fail), read_bag(bag))


@KINDS
def test_a_bag_without_definitions_is_read(tmp_path, bag_of, kind):
    bag = bag_of(kind)
    files, _ = open_bag(bag)
    topics = {s.topic: s.type_name for s in topic_schemas(files)}
    firsts = {raw.topic: raw for raw in raw_messages(files, frozenset(topics))}
    bare = write_raw(
        tmp_path / "bare.mcap",
        [(topic, name, "", firsts[topic].data) for topic, name in topics.items()],
        encodings=("cdr", ""),
    )
    said: list[str] = []
    (camera,) = read_bag(bare, warn=said.append).cameras
    assert len(camera.tracks) == 2
    assert "lacks the message definitions" in said[0]
