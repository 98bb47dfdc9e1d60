"""The topics of the views, and the files for RViz and Foxglove that name them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

import rclpy
from plain import info, poses
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from visualization_msgs.msg import Marker, MarkerArray

from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.ros.diagnostics import camera_status
from stcalib_ros.ros.driver_lenses import OFF
from stcalib_ros.ros.node import Calibrator

ROOT = Path(__file__).parents[2]
RVIZ = yaml.safe_load((ROOT / "rviz/calibration.rviz").read_text())["Visualization Manager"]
FOXGLOVE = json.loads((ROOT / "foxglove/calibration.json").read_text())
MARKERS = "visualization_msgs/msg/MarkerArray"


@pytest.fixture
def node(tmp_path: Path) -> Iterator[Any]:
    context = rclpy.Context()
    context.init()
    overrides = [Parameter("results_folder", value=str(tmp_path / "results"))]
    node = rclpy.create_node("calibrator", context=context, parameter_overrides=overrides)
    yield node
    node.destroy_node()
    context.shutdown()


@pytest.fixture
def calibrator(node: Any) -> Iterator[Calibrator]:
    made = Calibrator(node)
    yield made
    made.worker.stop(10.0)
    made.services.destroy()


def test_rviz_shows_topics_that_the_node_has_with_a_qos_that_fits(node, calibrator):
    shown = [d for d in RVIZ["Displays"] if d["Class"] == "rviz_default_plugins/MarkerArray"]
    topics = {d["Topic"]["Value"]: d["Topic"] for d in shown}
    assert set(topics) == {
        name
        for name, kinds in node.get_publisher_names_and_types_by_node("calibrator", "/")
        if MARKERS in kinds
    }
    for topic, asked in topics.items():
        (offered,) = node.get_publishers_info_by_topic(topic)
        assert offered.qos_profile.reliability.name == asked["Reliability Policy"].upper()
        assert offered.qos_profile.durability.name == asked["Durability Policy"].upper().replace(
            " ", "_"
        )


def test_foxglove_shows_topics_that_the_node_has(node, calibrator):
    there = dict(node.get_publisher_names_and_types_by_node("calibrator", "/"))
    panels = FOXGLOVE["configById"]
    (scene,) = (panel for name, panel in panels.items() if name.startswith("3D!"))
    assert {name for name, kinds in there.items() if MARKERS in kinds} == set(scene["topics"])
    for panel in panels.values():
        if (topic := panel.get("topicToRender")) is not None:
            assert there[topic] == ["diagnostic_msgs/msg/DiagnosticArray"]
        if (path := panel.get("topicPath")) is not None:
            topic, _, field = path.partition(".")
            (kind,) = there[topic]
            assert kind == "stcalib_ros/msg/CalibrationResult"
            from stcalib_ros.msg import CalibrationResult

            assert field in CalibrationResult.get_fields_and_field_types()


def panels_in(layout: Any) -> list[str]:
    if isinstance(layout, str):
        return [layout]
    assert layout["direction"] in ("row", "column")
    return panels_in(layout["first"]) + panels_in(layout["second"])


def test_the_layout_places_every_panel_once():
    assert sorted(panels_in(FOXGLOVE["layout"])) == sorted(FOXGLOVE["configById"])


def test_both_look_from_the_frame_that_the_node_has_by_default(calibrator):
    frame = calibrator.settings.view_frame
    assert RVIZ["Global Options"]["Fixed Frame"] == frame
    (scene,) = (p for name, p in FOXGLOVE["configById"].items() if name.startswith("3D!"))
    assert scene["followTf"] == frame


def test_rviz_names_the_namespaces_that_there_are():
    named = {n for d in RVIZ["Displays"] for n in d.get("Namespaces", {})}
    sources = "".join(
        (ROOT / f"stcalib_ros/ros/{module}.py").read_text()
        for module in ("markers", "people_markers", "coverage_markers")
    )
    assert {name for name in named if f'"{name}"' not in sources} == set()
    assert len(named) > 10


def test_nothing_is_drawn_until_somebody_looks_and_what_was_seen_is_known_all_the_same(
    node, calibrator
):
    for name in ("cam0", "cam1"):
        calibrator.buffers.add_info(name, info())
        for k in range(30):
            calibrator.buffers.add_poses(name, poses(100.0 + 0.1 * k, x=100.0 + 15.0 * k))
    views, counts = calibrator._views, calibrator.buffers.counts()
    views.refresh(calibrator.settings, counts, {})
    assert views.coverage["cam0"].share > 0.2
    assert views.coverage["cam0"].missing == "7 s more of people whom another camera sees, too"
    camera = calibrator.settings.cameras[0]
    given = ("calibrator", camera, counts["cam0"], "", None, OFF, views.coverage["cam0"])
    values = {pair.key: pair.value for pair in camera_status(*given).values}
    assert values["shared_with"] == "cam1: 3 s"
    assert values["image_covered"] == f"{views.coverage['cam0'].share:.2f}"
    assert values["needs"] == views.coverage["cam0"].missing
    drawn: list[MarkerArray] = []
    node.create_subscription(MarkerArray, "~/coverage_markers", drawn.append, 10)
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    for _ in range(200):
        executor.spin_once(timeout_sec=0.05)
        if drawn:
            break
    executor.shutdown()
    markers = drawn[0].markers
    assert {m.header.frame_id for m in markers} == {"cam0_optical_frame"}
    assert {m.ns for m in markers} >= {"images", "seen", "bars", "states"}
    assert all(m.lifetime.sec > 0 and m.action == Marker.ADD for m in markers)


def test_people_appear_on_the_common_clock_and_keep_their_ids(node, calibrator):
    """Two seconds of a scene, put into the buffers as messages would be."""
    scene = simulate(SceneOptions(n_cameras=2, n_people=2, n_frames=30, fps=10.0, seed=5))
    fill(calibrator, scene)
    calibrator._views.begin(scene.truth)
    drawn: list[MarkerArray] = []
    node.create_subscription(MarkerArray, "~/people_markers", drawn.append, 50)
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    for _ in range(400):
        executor.spin_once(timeout_sec=0.05)
        if len(drawn) > 5:
            break
    executor.shutdown()
    assert len(drawn) > 5
    ids = [{m.id for m in array.markers if m.ns == "joints"} for array in drawn]
    assert set().union(*ids) == {0, 1}
    stamps = [array.markers[-1].header.stamp for array in drawn]
    times = [stamp.sec + 1e-9 * stamp.nanosec for stamp in stamps]
    assert times == sorted(times)
    epoch_s = scene.recording.epoch_ns * 1e-9
    assert all(epoch_s <= t <= epoch_s + 3.5 for t in times)


def fill(calibrator: Calibrator, scene: Any) -> None:
    from foreign_messages import images_of

    for camera in scene.recording.cameras:
        lens = camera.intrinsics
        given = {"k": lens.K.ravel().tolist(), "width": lens.width, "height": lens.height}
        calibrator.buffers.add_info(camera.name, info(**given))
        for stamp, persons in zip(camera.stamps, images_of(camera), strict=True):
            calibrator.buffers.add_poses(
                camera.name, message(scene.recording.epoch_ns * 1e-9 + stamp, camera, persons)
            )


def message(stamp_s: float, camera: Any, persons: Any) -> Any:
    names = camera.layout.joint_names
    nan = (float("nan"),) * 2
    made = poses(stamp_s, persons=0, layout=camera.layout.name)
    for seen in persons:
        keypoints = [float(v) for n in names for v in seen.keypoints.get(n, nan)]
        (one,) = poses(stamp_s, persons=1, joints=(), keypoints=keypoints).persons
        one.track_id = seen.track_id
        made.persons.append(one)
    return made
