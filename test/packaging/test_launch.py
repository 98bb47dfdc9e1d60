"""The launch files, with stand-ins for `launch`, which no wheel brings."""

from __future__ import annotations

import runpy
import sys
from types import ModuleType, SimpleNamespace

import pytest

MODULES = {
    "launch": ["LaunchDescription"],
    "launch.actions": ["DeclareLaunchArgument"],
    "launch.conditions": ["IfCondition"],
    "launch.substitutions": ["LaunchConfiguration", "PathJoinSubstitution"],
    "launch_ros": [],
    "launch_ros.actions": ["Node"],
    "launch_ros.substitutions": ["FindPackageShare"],
}


@pytest.fixture
def launch(monkeypatch: pytest.MonkeyPatch) -> None:
    for module, names in MODULES.items():
        stand_in = ModuleType(module)
        for name in names:
            setattr(
                stand_in,
                name,
                lambda *args, kind=name, **given: SimpleNamespace(kind=kind, args=args, **given),
            )
        monkeypatch.setitem(sys.modules, module, stand_in)


@pytest.mark.parametrize("name", ["calibrator", "restamp"])
def test_it_starts_the_node_with_a_parameter_file(launch, root, name):
    file = runpy.run_path(str(root / f"launch/{name}.launch.py"))
    (actions,) = file["generate_launch_description"]().args
    (node,) = (a for a in actions if a.kind == "Node" and a.package == "stcalib_ros")
    assert node.executable == name
    assert (root / "bin" / node.executable).is_file()
    declared = {a.args[0] for a in actions if a.kind == "DeclareLaunchArgument"}
    assert {p.args[0] for p in (*node.parameters, node.namespace)} == declared - {"view"}
    (installed,) = (a.default_value for a in actions if a.args[:1] == ("params_file",))
    assert (root / "/".join(installed.args[0][1:])) == root / f"config/{name}.yaml"
    assert (root / f"config/{name}.yaml").is_file()


def test_rviz_is_started_on_request_with_the_topics_of_the_namespace(launch, root):
    file = runpy.run_path(str(root / "launch/calibrator.launch.py"))
    (actions,) = file["generate_launch_description"]().args
    (viewer,) = (a for a in actions if a.kind == "Node" and a.package == "rviz2")
    assert viewer.condition.args[0].args == ("view",)
    (view,) = (a for a in actions if a.args[:1] == ("view",))
    assert view.default_value == "false"
    option, config = viewer.arguments
    assert (option, root / "/".join(config.args[0][1:])) == ("-d", root / "rviz/calibration.rviz")
    shown = (root / "rviz/calibration.rviz").read_text()
    for topic, there in viewer.remappings:
        assert f"Value: {topic}\n" in shown
        top, namespace, name = there.args[0]
        assert (top, namespace.args, f"/{name}") == ("/", ("namespace",), topic)
    assert len(viewer.remappings) == shown.count("Value: /calibrator/")


def test_from_cameras_starts_the_estimator_and_the_calibrator(launch, root):
    file = runpy.run_path(str(root / "launch/from_cameras.launch.py"))
    (actions,) = file["generate_launch_description"]().args
    nodes = [a for a in actions if a.kind == "Node"]
    assert [node.executable for node in nodes] == ["pose_estimator", "calibrator"]
    defaults = {a.args[0]: a.default_value for a in actions if a.kind == "DeclareLaunchArgument"}
    used = {p.args[0] for node in nodes for p in (*node.parameters, node.namespace)}
    assert used == set(defaults)
    for node in nodes:
        (parameters,) = node.parameters
        installed = defaults[parameters.args[0]]
        assert "/".join(installed.args[0][1:]) == f"config/{node.executable}.yaml"
        assert (root / f"config/{node.executable}.yaml").is_file()
        assert (root / "bin" / node.executable).is_file()
