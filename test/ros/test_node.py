"""The live node within this process: what it does between a request and an answer."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

import rclpy
from plain import info, poses
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.options import Options
from stcalib_ros.ros.node import Calibrator
from stcalib_ros.ros.worker import Job

REFUSED_S = 11.0


@pytest.fixture
def node(tmp_path: Path) -> Iterator[Any]:
    """A node on which somebody else refuses a window of eleven seconds, after us."""
    context = rclpy.Context()
    context.init()
    overrides = [Parameter("results_folder", value=str(tmp_path / "results"))]
    node = rclpy.create_node("calibrator", context=context, parameter_overrides=overrides)
    node.add_on_set_parameters_callback(refuse)
    yield node
    node.destroy_node()
    context.shutdown()


def refuse(changes: list[Parameter]) -> SetParametersResult:
    wrong = any(p.name == "window_s" and p.value == REFUSED_S for p in changes)
    return SetParametersResult(successful=not wrong)


@pytest.fixture
def calibrator(node: Any) -> Iterator[Calibrator]:
    made = Calibrator(node)
    yield made
    made.worker.stop(10.0)
    made.services.destroy()


def set_window(node: Any, seconds: float) -> bool:
    (result,) = node.set_parameters([Parameter("window_s", value=seconds)])
    return bool(result.successful)


def test_a_change_that_somebody_else_refuses_does_not_happen(node, calibrator):
    assert set_window(node, 12.0)
    assert calibrator.settings.limits.window_s == 12.0
    assert not set_window(node, REFUSED_S)
    assert calibrator.settings.limits.window_s == 12.0


def test_parameters_that_do_not_go_together_change_nothing(node, calibrator):
    changes = [Parameter("window_s", value=13.0), Parameter("reference", value="cam9")]
    result = node.set_parameters_atomically(changes)
    assert (result.successful, "cam9" in result.reason) == (False, True)
    assert calibrator.settings.limits.window_s == 30.0
    assert set_window(node, 14.0), "and what comes next is judged without them"
    assert calibrator.settings.limits.window_s == 14.0


def test_a_worker_that_is_busy_refuses_a_run_and_no_later_one(calibrator):
    for name in ("cam0", "cam1"):
        calibrator.buffers.add_info(name, info())
        calibrator.buffers.add_poses(name, poses(100.0))
    other = Job("other", calibrator.buffers.snapshot(), Options(), True)
    assert calibrator.worker.start(other)
    refused = calibrator.start()
    assert isinstance(refused, Calibration)
    assert refused.status is Status.CANCELLED
    assert calibrator.run is None
    calibrator.worker.stop(30.0)
    assert calibrator.worker.collect() is not None
    assert not isinstance(calibrator.start(), Calibration)
