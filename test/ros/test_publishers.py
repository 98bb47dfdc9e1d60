"""What is latched of a calibration, and of the one that replaces it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from live import Client
from samples import LENS, STAMP, calibration
from sensor_msgs.msg import CameraInfo

from stcalib_ros.core.model.calibration import CameraCalibration
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.ros.convert import calibration_result
from stcalib_ros.ros.publishers import Publishers

CALIBRATION = calibration()


@dataclass
class Settings:
    cameras: tuple[CameraCalibration, ...] = CALIBRATION.cameras
    publish_tf: bool = False
    tf_not_metric: bool = False
    tf_suffix: str = ""


@pytest.fixture
def client() -> Iterator[Client]:
    made = Client("publishers")
    yield made
    made.close()


def publish(publishers: Publishers, **changes: Any) -> None:
    """Publish the calibration with another first camera."""
    first, *others = CALIBRATION.cameras
    changed = replace(CALIBRATION, cameras=(replace(first, **changes), *others))
    publishers.publish(changed, calibration_result(changed, run_id="", stamp=STAMP))


def heard(client: Client, camera: str) -> list[Any]:
    received: list[Any] = []
    topic = f"/client_of_publishers/{camera}/camera_info"
    client.node.create_subscription(CameraInfo, topic, received.append, 10)
    return received


def test_of_lenses_those_are_published_that_were_estimated_and_what_follows_them(client):
    publishers = Publishers(client.node, Settings())
    first, second = heard(client, "cam0"), heard(client, "cam1")
    publish(publishers)
    found = replace(LENS, K=np.diag([700.0, 700.0, 1.0]))
    publish(publishers, intrinsics=found, lens_knowledge=LensKnowledge.UNKNOWN)
    client.wait(lambda: len(first) == 1, "the lens that was estimated")
    publish(publishers)
    client.wait(lambda: len(first) == 2, "the one that replaces it")
    assert [info.k[0] for info in first] == [700.0, 600.0]
    assert second == []


def test_a_name_that_can_be_in_no_topic_costs_only_that_topic(client):
    cameras = (replace(CALIBRATION.cameras[0], name="my-camera"), *CALIBRATION.cameras[1:])
    named = replace(CALIBRATION, cameras=cameras)
    publishers = Publishers(client.node, Settings(cameras))
    second = heard(client, "cam1")
    estimated = tuple(replace(c, lens_knowledge=LensKnowledge.REFINE) for c in named.cameras)
    named = replace(named, cameras=estimated)
    publishers.publish(named, calibration_result(named, run_id="", stamp=STAMP))
    client.wait(lambda: len(second) == 1, "the lens of another camera")


class Frames:
    """In place of the publisher of /tf_static: tf2_msgs has no wheel."""

    def __init__(self) -> None:
        self.sent: list[list[Any]] = []

    def publish(self, transforms: list[Any]) -> None:
        self.sent.append(transforms)


def of(frames: list[Any]) -> set[tuple[str, str]]:
    return {(frame.header.frame_id, frame.child_frame_id) for frame in frames}


def test_the_frame_to_look_from_is_sent_with_all_others_and_only_when_it_changes(client):
    frames, view = Frames(), np.eye(4)
    publishers = Publishers(client.node, Settings(publish_tf=True))
    publishers._tf = (lambda transforms: transforms), frames
    publish(publishers)
    cameras = of(frames.sent[-1])
    publishers.show_view("view", "cam1_optical_frame", view)
    assert of(frames.sent[-1]) == cameras | {("cam1_optical_frame", "view")}
    publishers.show_view("view", "cam1_optical_frame", view)
    assert len(frames.sent) == 2
    view[2, 3] = 1.5
    publishers.show_view("view", "cam1_optical_frame", view)
    (shown,) = (f for f in frames.sent[-1] if f.child_frame_id == "view")
    assert (len(frames.sent), shown.transform.translation.z) == (3, 1.5)
    publish(publishers)
    assert of(frames.sent[-1]) == cameras | {("cam1_optical_frame", "view")}
    publishers.show_view("", "cam1_optical_frame", np.eye(4))
    assert len(frames.sent) == 4, "without a name there is none"


def test_the_frame_to_look_from_needs_neither_metres_nor_the_frames_of_cameras(client):
    for settings in (Settings(publish_tf=False), Settings(publish_tf=True)):
        frames, publishers = Frames(), Publishers(client.node, settings)
        publishers._tf = (lambda transforms: transforms), frames
        unscaled = replace(CALIBRATION, metric=False)
        publishers.publish(unscaled, calibration_result(unscaled, run_id="", stamp=STAMP))
        publishers.show_view("view", "cam1_optical_frame", np.eye(4))
        assert [of(sent) for sent in frames.sent] == [{("cam1_optical_frame", "view")}]
