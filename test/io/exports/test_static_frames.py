"""Frames of cameras in URDF, xacro and launch files, as their readers have them."""

from __future__ import annotations

import ast
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from export_helpers import (
    FISHEYE,
    PINHOLE,
    RECTIFIED,
    in_world,
    rig,
    written,
)
from scipy.spatial.transform import Rotation


def joint_poses(robot: Any) -> dict[str, np.ndarray]:
    """Poses (4, 4) of all links of a robot in its root."""
    poses = {robot.get_root(): np.eye(4)}
    for joint in robot.joints:  # a parent comes before its children
        assert joint.type == "fixed"
        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler("xyz", joint.origin.rpy).as_matrix()  # fixed axes
        T[:3, 3] = joint.origin.xyz
        poses[joint.child] = poses[joint.parent] @ T
    return poses


def check_pose(T: np.ndarray, one: Any) -> None:
    np.testing.assert_allclose(T[:3, :3], one.R_ref_cam, atol=1e-12)
    np.testing.assert_allclose(T[:3, 3], one.t_ref_cam, atol=1e-12)


@pytest.mark.parametrize("place", [lambda one: one, in_world])
def test_urdf_has_the_frames_as_fixed_joints(tmp_path: Path, place: Any) -> None:
    urdf = pytest.importorskip("urdf_parser_py.urdf", reason="of requirements/test.txt")
    calibration = place(rig(PINHOLE, PINHOLE, RECTIFIED))
    text = written(calibration, "urdf", tmp_path / "cameras.urdf").read_text()
    poses = joint_poses(urdf.URDF.from_xml_string(text.partition("?>")[2]))
    assert len(poses) == 3 + bool(calibration.frame_id)
    for one in calibration.cameras:
        check_pose(poses[one.frame_id], one)


def test_a_camera_that_looks_down_an_axis_has_a_pose_in_urdf_too(tmp_path: Path) -> None:
    urdf = pytest.importorskip("urdf_parser_py.urdf", reason="of requirements/test.txt")
    for angles in ((0.3, np.pi / 2, 0.0), (0.3, -np.pi / 2, 0.7), (np.pi, 0.0, np.pi)):
        calibration = rig(PINHOLE, PINHOLE)
        R = Rotation.from_euler("xyz", angles).as_matrix()
        second = replace(calibration.cameras[1], R_ref_cam=R)
        calibration = replace(calibration, cameras=(calibration.cameras[0], second))
        text = written(calibration, "urdf", tmp_path / "cameras.urdf").read_text()
        poses = joint_poses(urdf.URDF.from_xml_string(text.partition("?>")[2]))
        check_pose(poses[second.frame_id], second)


def test_xacro_makes_the_frames_below_any_link(tmp_path: Path) -> None:
    xacro = pytest.importorskip("xacro", reason="of requirements/test.txt")
    urdf = pytest.importorskip("urdf_parser_py.urdf", reason="of requirements/test.txt")
    calibration = in_world(rig(PINHOLE, PINHOLE))
    written(calibration, "urdf", tmp_path / "cameras.xacro")
    (tmp_path / "robot.xacro").write_text(
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<xacro:include filename="cameras.xacro"/><link name="base"/>'
        '<xacro:stcalib_cameras parent="base" prefix="a_" xyz="1 0 0"/></robot>'
    )
    document = xacro.process_file(str(tmp_path / "robot.xacro"))
    poses = joint_poses(urdf.URDF.from_xml_string(document.documentElement.toxml()))
    np.testing.assert_array_equal(poses["a_world"][:3, 3], [1, 0, 0])
    for one in calibration.cameras:
        check_pose(np.linalg.inv(poses["a_world"]) @ poses[f"a_{one.frame_id}"], one)


def launched(path: Path, monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Return the arguments of all nodes of a launch file; launch itself has no wheel."""
    if path.suffix == ".xml":
        nodes = ET.fromstring(path.read_text()).findall("node")
        assert {node.attrib["exec"] for node in nodes} == {"static_transform_publisher"}
        return [shlex.split(node.attrib["args"]) for node in nodes]
    record = SimpleNamespace(LaunchDescription=list, Node=lambda **given: given)
    for name in ("launch", "launch_ros", "launch_ros.actions"):
        monkeypatch.setitem(sys.modules, name, record)
    scope: dict[str, Any] = {}
    exec(compile(ast.parse(path.read_text()), path.name, "exec"), scope)
    nodes = scope["generate_launch_description"]()
    assert {(n["package"], n["executable"]) for n in nodes} == {
        ("tf2_ros", "static_transform_publisher")
    }
    return [node["arguments"] for node in nodes]


@pytest.mark.parametrize("name", ["cameras.launch.py", "cameras.launch.xml"])
def test_launch_files_start_a_publisher_per_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    calibration = rig(PINHOLE, FISHEYE, RECTIFIED)
    arguments = launched(written(calibration, "launch", tmp_path / name), monkeypatch)
    assert len(arguments) == 2  # the frame of the first is the reference
    for words, one in zip(arguments, calibration.cameras[1:], strict=True):
        given = dict(zip(words[::2], words[1::2], strict=True))
        assert given["--frame-id"] == "cam0_optical_frame"
        assert given["--child-frame-id"] == one.frame_id
        T = np.eye(4)
        T[:3, 3] = [float(given[key]) for key in ("--x", "--y", "--z")]
        q = [float(given[key]) for key in ("--qx", "--qy", "--qz", "--qw")]
        T[:3, :3] = Rotation.from_quat(q).as_matrix()
        check_pose(T, one)
