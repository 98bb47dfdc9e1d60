"""A message type that we do not know yet takes its own module and an entry in the table."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from bag_helpers import CAMERA_INFO, START_NS, schema_text, write_raw

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.bag import open_bag, read_bag
from stcalib_ros.io.bag_source import raw_messages
from stcalib_ros.io.cdr import CdrReader, CdrWriter
from stcalib_ros.io.message_types import TYPES, Content, MessageType, decode
from stcalib_ros.io.message_types.message_type import HEADER, TIME, decode_header
from stcalib_ros.ros.buffers import Buffers
from stcalib_ros.ros.intake import Intake
from stcalib_ros.ros.load import Meter
from stcalib_ros.ros.streams import Limits

TEXT = "std_msgs/Header header\nfloat32[] keypoints\nfloat32[] joints\n"


def one_person(cdr: CdrReader) -> SimpleNamespace:
    header = decode_header(cdr)
    keypoints, joints = cdr.float32s(), cdr.float32s()
    person = SimpleNamespace(
        track_id=0, score=1.0, joints=joints, keypoints=keypoints, joint_scores=[]
    )
    return SimpleNamespace(
        header=header,
        layout="h36m_17",
        joint_names=[],
        rectified=False,
        metric=False,
        persons=[person],
    )


SOLO = MessageType(
    name="solo_msgs/msg/Skeleton",
    content=Content.POSES,
    definition=lambda: TEXT,
    dependencies=(HEADER, TIME),
    decode=one_person,
)
KEYPOINTS, JOINTS = np.arange(34.0), np.arange(51.0)


def header(cdr: CdrWriter) -> None:
    cdr.int32(START_NS // 10**9)
    cdr.uint32(0)
    cdr.string("cam0_optical_frame")


def skeleton() -> bytes:
    cdr = CdrWriter()
    header(cdr)
    cdr.float32s(KEYPOINTS)
    cdr.float32s(JOINTS)
    return cdr.data()


def camera_info() -> bytes:
    cdr = CdrWriter()
    header(cdr)
    cdr.uint32(480)
    cdr.uint32(640)
    cdr.string("plumb_bob")
    cdr.float64s([0.0] * 5)
    for matrix in ([800.0, 0, 320, 0, 800, 240, 0, 0, 1], [0.0] * 9, [0.0] * 12):
        cdr.float64s(matrix, fixed=True)
    for _ in range(6):
        cdr.uint32(0)
    cdr.boolean(False)
    return cdr.data()


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return write_raw(
        tmp_path / "solo.mcap",
        [
            ("/cam0/skeleton", SOLO.name, SOLO.schema_text(), skeleton()),
            ("/cam0/camera_info", CAMERA_INFO, schema_text(CAMERA_INFO), camera_info()),
        ],
    )


def test_it_is_unknown_at_first(bag):
    with pytest.raises(InputError, match="no topic of type stcalib_ros/msg/PersonPose3DArray"):
        read_bag(bag)


def test_with_its_entry_it_is_read_from_bags(bag, monkeypatch):
    monkeypatch.setitem(TYPES, SOLO.name, SOLO)
    (camera,) = read_bag(bag).cameras
    (track,) = camera.tracks
    np.testing.assert_array_equal(track.keypoints.ravel(), KEYPOINTS)
    np.testing.assert_array_equal(track.joints.ravel(), JOINTS)
    assert (camera.name, camera.intrinsics.K[0, 0]) == ("cam0", 800.0)


def test_with_its_entry_it_is_received_live(bag, monkeypatch):
    monkeypatch.setitem(TYPES, SOLO.name, SOLO)
    files, cameras = open_bag(bag)
    buffers = Buffers(cameras, Limits(), lambda _about, line: pytest.fail(line))
    intake = Intake(cameras, buffers, Meter())
    takes = {cameras[0].pose_topic: intake.poses_of(cameras[0])}
    takes[cameras[0].info_topic] = intake.info_of(cameras[0])
    for message in raw_messages(files, frozenset(takes)):
        about = {"publication_sequence_number": 1, "received_timestamp": message.log_time}
        takes[message.topic](message.data, about)
    ((image,),) = [c.images for c in buffers.snapshot()]
    np.testing.assert_array_equal(image.keypoints.ravel(), KEYPOINTS)


def test_its_definition_is_compared_with_ours(bag, monkeypatch):
    other = MessageType(
        name=SOLO.name,
        content=SOLO.content,
        definition=lambda: TEXT.replace("float32", "float64"),
        dependencies=SOLO.dependencies,
        decode=SOLO.decode,
    )
    monkeypatch.setitem(TYPES, SOLO.name, other)
    with pytest.raises(InputError, match="another definition of solo_msgs/msg/Skeleton"):
        read_bag(bag)


def test_what_is_not_in_the_table_is_not_decoded():
    with pytest.raises(KeyError):
        decode(SOLO.name, skeleton())
