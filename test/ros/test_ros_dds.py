"""Our messages between two processes over real DDS."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from samples import poses_message, result_message
from stcalib_ros.msg import CalibrationResult, PersonPose3DArray
from talker import LATCHED

TIMEOUT_S = 30.0


@pytest.fixture(scope="module")
def talker() -> Iterator[None]:
    here = Path(__file__)
    paths = [str(here.parents[2]), os.environ.get("PYTHONPATH", "")]
    process = subprocess.Popen(
        [sys.executable, str(here.parents[1] / "helpers" / "talker.py")],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
    )
    yield
    assert process.poll() is None, "the talker died"
    process.terminate()
    process.wait(timeout=10)


@pytest.fixture
def spin_until() -> Iterator[tuple[Node, Callable[[Callable[[], bool]], bool]]]:
    context = rclpy.Context()
    context.init()
    executor = SingleThreadedExecutor(context=context)
    node = rclpy.create_node("listener", context=context)
    executor.add_node(node)

    def spin(done: Callable[[], bool]) -> bool:
        deadline = time.monotonic() + TIMEOUT_S
        while not done() and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.1)
        return done()

    yield node, spin
    executor.shutdown()
    node.destroy_node()
    context.shutdown()


@pytest.mark.parametrize(
    ("kind", "topic", "qos", "expected"),
    [
        (CalibrationResult, "result", LATCHED, result_message()),
        (PersonPose3DArray, "cam0/person_poses", qos_profile_sensor_data, poses_message()),
    ],
    ids=["result", "poses"],
)
def test_what_one_process_sends_another_has(talker, spin_until, kind, topic, qos, expected):
    node, spin = spin_until
    received = []
    node.create_subscription(kind, topic, received.append, qos)
    assert spin(lambda: bool(received)), f"nothing on {topic} within {TIMEOUT_S} s"
    differing = [
        path
        for (path, value), (_, sent) in zip(leaves(received[0]), leaves(expected), strict=True)
        if not np.array_equal(value, sent, equal_nan=not isinstance(sent, str))
    ]
    assert not differing


def leaves(message: object, path: str = "") -> Iterator[tuple[str, Any]]:
    """All numbers, arrays and texts in a message, with where they are."""
    if hasattr(message, "get_fields_and_field_types"):
        for name in message.get_fields_and_field_types():
            yield from leaves(getattr(message, name), f"{path}.{name}")
    elif isinstance(message, list):
        yield f"{path}.length", len(message)
        for i, item in enumerate(message):
            yield from leaves(item, f"{path}[{i}]")
    else:
        yield path, message
