"""Bytes into the buffers; without ROS."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.bag_records import RawMessage
from stcalib_ros.io.bag_source import raw_messages
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.cdr import CdrWriter
from stcalib_ros.io.topics import SelectedCamera
from stcalib_ros.ros.buffers import Buffers
from stcalib_ros.ros.intake import Intake
from stcalib_ros.ros.limits import MAX_TEXT
from stcalib_ros.ros.load import Meter
from stcalib_ros.ros.streams import Limits

CAMERA = SelectedCamera("cam0", "/cam0/person_poses", "/cam0/camera_info", None)


@pytest.fixture(scope="module")
def messages(tmp_path_factory: pytest.TempPathFactory) -> list[RawMessage]:
    path = tmp_path_factory.mktemp("bag") / "walk.mcap"
    options = SceneOptions(n_cameras=2, n_people=2, n_frames=40, seed=1)
    write_bag(simulate(options).recording, path)
    return list(raw_messages([path], frozenset({CAMERA.pose_topic, CAMERA.info_topic})))


@pytest.fixture
def lines() -> list[str]:
    return []


@pytest.fixture
def buffers(lines: list[str]) -> Buffers:
    return Buffers([CAMERA], Limits(), lambda _about, line: lines.append(line))


@pytest.fixture
def meter() -> Meter:
    return Meter()


@pytest.fixture
def intake(buffers: Buffers, meter: Meter) -> Intake:
    return Intake([CAMERA], buffers, meter)


def about(number: int = 1, *, age_s: float = 0.0) -> dict[str, int]:
    received_ns = time.time_ns() - round(age_s * 1e9)
    return {"publication_sequence_number": number, "received_timestamp": received_ns}


def of_topic(messages: list[RawMessage], topic: str) -> list[bytes]:
    return [m.data for m in messages if m.topic == topic]


def test_what_is_sent_is_in_the_buffer(messages, intake, buffers, meter):
    poses = of_topic(messages, CAMERA.pose_topic)
    take = intake.poses_of(CAMERA)
    for number, data in enumerate(poses):
        take(data, about(number, age_s=5.0))
    intake.info_of(CAMERA)(of_topic(messages, CAMERA.info_topic)[0], about())
    counts = buffers.counts()["cam0"]
    assert (counts.images, counts.received, counts.dropped) == (len(poses), len(poses), 0)
    assert counts.has_info
    load = meter.load()
    assert load.messages == len(poses)
    assert 5.0 <= load.delay_p50_s < 60.0
    assert intake.lost() == {"cam0": 0}


def test_gaps_are_lost(messages, intake):
    take = intake.poses_of(CAMERA)
    for number, data in enumerate(of_topic(messages, CAMERA.pose_topic)):
        if number not in (3, 4, 10):
            take(data, about(number))
    assert intake.lost() == {"cam0": 3}


def test_every_cut_message_is_counted_said_and_dropped(messages, intake, buffers, lines):
    data = of_topic(messages, CAMERA.pose_topic)[0]
    take = intake.poses_of(CAMERA)
    for n in range(len(data)):
        take(data[:n], about())
    counts = buffers.counts()["cam0"]
    assert (counts.images, counts.dropped, counts.received) == (0, len(data), len(data))
    assert lines[0].startswith("/cam0/person_poses: not a readable stcalib_ros/msg/PersonPose3D")
    take(data, about())
    assert buffers.counts()["cam0"].images == 1


def test_random_bytes_do_no_harm(messages, intake, buffers):
    rng = np.random.default_rng(0)
    good = of_topic(messages, CAMERA.pose_topic)[0], of_topic(messages, CAMERA.info_topic)[0]
    takes = intake.poses_of(CAMERA), intake.info_of(CAMERA)
    takes[0](good[0], about())
    for k in range(1000):
        damaged = bytearray(good[k % 2])
        for at in rng.integers(0, len(damaged), 5):
            damaged[at] = rng.integers(256)
        takes[k % 2](bytes(damaged), about())
        takes[k % 2](rng.bytes(int(rng.integers(0, 200))), about())
    counts = buffers.counts()["cam0"]
    assert counts.dropped >= 1000
    assert counts.images <= 1 + 500


def test_a_count_that_does_not_fit_is_refused_at_once(messages, intake, buffers, lines):
    data = bytearray(of_topic(messages, CAMERA.pose_topic)[0])
    at = data.index(b"h36m_17") + 12 + 4  # layout, no names, two flags; then the count
    at += -at % 4
    data[at : at + 4] = (2**32 - 1).to_bytes(4, "little")
    intake.poses_of(CAMERA)(bytes(data), about())
    assert f"{2**32 - 1} persons do not fit" in lines[-1]


def test_a_repeated_lens_is_no_news_and_another_one_is(messages, intake, buffers, lines):
    first, second = of_topic(messages, CAMERA.info_topic)[:2]
    assert first != second, "they differ in their stamps"
    take = intake.info_of(CAMERA)
    take(first, about())
    take(second, about())
    assert buffers.counts()["cam0"].has_info
    take(b"\x00\x01\x00\x00nonsense", about())
    take(second, about())
    assert len(lines) == 1
    assert "/cam0/camera_info: not a readable sensor_msgs/msg/CameraInfo" in lines[0]


def largest_message(limits: Limits) -> bytes:
    """As much as the limits allow, each name of the longest kind and of two bytes a character."""
    long, (n, j) = "\u00e4" * MAX_TEXT, (limits.max_persons, limits.max_joints)
    cdr = CdrWriter()
    cdr.int32(5)
    cdr.uint32(0)
    cdr.string(long)
    cdr.string(long)
    cdr.strings([long[:-3] + f"{k:03d}" for k in range(j)])
    cdr.boolean(False)
    cdr.boolean(True)
    cdr.uint32(n)
    for k in range(n):
        cdr.uint32(k)
        cdr.float32(1.0)
        for width in (3, 2, 1):
            cdr.float32s(np.ones(j * width))
    return cdr.data()


def test_what_the_limits_allow_is_decoded_and_what_is_longer_is_not(intake, buffers, lines):
    take = intake.poses_of(CAMERA)
    data = largest_message(Limits())
    assert len(data) > 100_000
    take(data, about())
    assert buffers.counts()["cam0"].images == 1
    take(data + bytes(100_000), about(2))
    counts = buffers.counts()["cam0"]
    assert (counts.images, counts.dropped) == (1, 1)
    assert "allow no more than" in lines[-1]


def test_a_message_of_millions_of_persons_costs_nothing(intake, buffers):
    data = bytearray(largest_message(Limits(max_persons=1, max_joints=1)))
    for count in (3_000_000, 2**32 - 1):
        for at in range(4, len(data) - 4, 4):
            broken = bytearray(data)
            broken[at : at + 4] = count.to_bytes(4, "little")
            intake.poses_of(CAMERA)(bytes(broken), about())
    counts = buffers.counts()["cam0"]
    assert counts.received == counts.dropped + counts.images + counts.set_aside
    assert counts.dropped > 100


def test_a_camera_that_sends_no_image_without_a_person_is_not_starved():
    kind = "visualization_msgs/msg/MarkerArray"
    camera = SelectedCamera("cam0", "/cam0/body_tracking_data", "/cam0/i", None, pose_type=kind)
    buffers = Buffers([camera], Limits(), lambda _about, line: pytest.fail(line))
    take = Intake([camera], buffers, Meter()).poses_of(camera)
    assert math.isinf(buffers.counts()["cam0"].age_s)
    no_markers = bytes.fromhex("0001000000000000")
    take(no_markers, {"publication_sequence_number": 1, "received_timestamp": 0})
    counts = buffers.counts()["cam0"]
    assert (counts.age_s < 10.0, counts.images, counts.dropped) == (True, 0, 0)
