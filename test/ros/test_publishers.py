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
