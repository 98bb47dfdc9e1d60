"""Camera frames as fixed joints (URDF, xacro) and as static transforms (launch files)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import indent

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.so3 import quaternion_from_matrix
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.io.exports.export_format import Exported, ExportFormat, Files, unique

_PLAIN = re.compile(r"[A-Za-z0-9_./-]+")
"""Names of frames that mean nothing else in XML, in xacro, in Python or on a command line."""

_HEAD = '<?xml version="1.0"?>\n'

_XACRO = """\
<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <!-- <xacro:stcalib_cameras parent="world"/> fixes the reference frame to that link. -->
  <xacro:macro name="stcalib_cameras" params="parent prefix:='' xyz:='0 0 0' rpy:='0 0 0'">
{body}  </xacro:macro>
</robot>
"""

_PYTHON = '''\
"""Camera frames as static transforms."""

from launch import LaunchDescription
from launch_ros.actions import Node

FRAMES = [
    # child frame, x, y, z in metres, quaternion x, y, z, w
{rows}]


def generate_launch_description():
    nodes = []
    for child, *numbers in FRAMES:
        names = ("--x", "--y", "--z", "--qx", "--qy", "--qz", "--qw")
        arguments = [word for pair in zip(names, map(repr, numbers)) for word in pair]
        arguments += ["--frame-id", {frame!r}, "--child-frame-id", child]
        nodes.append(
            Node(
                package="tf2_ros",
                executable="static_transform_publisher",
                arguments=arguments,
            )
        )
    return LaunchDescription(nodes)
'''


@dataclass(frozen=True, slots=True, eq=False)
class _StaticFrame:
    """Pose of a camera's optical frame in the reference frame, metres."""

    child: str
    R: Float64Array
    t: Float64Array

    def quaternion(self) -> list[float]:
        """Return x, y, z and w."""
        return [float(value) for value in quaternion_from_matrix(self.R)]

    def rpy(self) -> list[float]:
        """Return rotations about the fixed axes x, y and z, one after the other, rad."""
        R = self.R
        pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
        yaw = np.arctan2(R[1, 0], R[0, 0])
        c, s = np.cos(yaw), np.sin(yaw)
        roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
        return [float(roll), float(pitch), float(yaw)]


def _frames(calibration: Calibration) -> list[_StaticFrame]:
    """Return all frames but the one that is the reference."""
    children = [camera.frame_id for camera in calibration.cameras]
    unique(children, "frame")
    for frame in (calibration.reference_frame, *children):
        if not _PLAIN.fullmatch(frame):
            raise InputError(
                f"frame {frame!r}: frames of URDF and launch files have letters, digits and "
                "_ . / - only; rename it in the result file"
            )
    return [
        _StaticFrame(camera.frame_id, camera.R_ref_cam, camera.t_ref_cam)
        for camera in calibration.cameras
        if camera.frame_id != calibration.reference_frame
    ]


def _urdf(exported: Exported, name: str) -> Files:
    root, frames = exported.calibration.reference_frame, _frames(exported.calibration)
    if name.lower().endswith(".xacro"):
        root = f"${{prefix}}{root}"
        body = _link(root) + _joint("${parent}", root, "${xyz}", "${rpy}")
        body += _joints(root, frames, "${prefix}")
        return {name: _HEAD + _XACRO.format(body=indent(body, "  "))}
    body = _link(root) + _joints(root, frames)
    return {name: f'{_HEAD}<robot name="stcalib_cameras">\n{body}</robot>\n'}


def _joints(root: str, frames: Sequence[_StaticFrame], prefix: str = "") -> str:
    return "".join(
        _link(prefix + frame.child)
        + _joint(root, prefix + frame.child, _words(frame.t), _words(frame.rpy()))
        for frame in frames
    )


def _link(name: str) -> str:
    return f'  <link name="{name}"/>\n'


def _joint(parent: str, child: str, xyz: str, rpy: str) -> str:
    return (
        f'  <joint name="{child}_joint" type="fixed">\n'
        f'    <parent link="{parent}"/>\n'
        f'    <child link="{child}"/>\n'
        f'    <origin xyz="{xyz}" rpy="{rpy}"/>\n'
        "  </joint>\n"
    )


def _launch(exported: Exported, name: str) -> Files:
    root, frames = exported.calibration.reference_frame, _frames(exported.calibration)
    if name.lower().endswith(".py"):
        rows = "".join(
            f"    {(frame.child, *map(float, frame.t), *frame.quaternion())!r},\n"
            for frame in frames
        )
        return {name: _PYTHON.format(frame=root, rows=rows)}
    return {name: f"{_HEAD}<launch>\n{''.join(_node(root, frame) for frame in frames)}</launch>\n"}


def _node(root: str, frame: _StaticFrame) -> str:
    names = ("--x", "--y", "--z", "--qx", "--qy", "--qz", "--qw")
    numbers = [*frame.t, *frame.quaternion()]
    words = [f"{key} {float(value)!r}" for key, value in zip(names, numbers, strict=True)]
    words += [f"--frame-id {root}", f"--child-frame-id {frame.child}"]
    return f"""\
  <node pkg="tf2_ros" exec="static_transform_publisher"
        args="{" ".join(words)}"/>
"""


def _words(values: Sequence[float] | Float64Array) -> str:
    return " ".join(repr(float(value)) for value in values)


URDF = ExportFormat(
    "urdf",
    "camera frames as fixed joints, or a macro with them",
    _urdf,
    endings=(".urdf", ".xacro"),
    needs_metres=True,
)
LAUNCH = ExportFormat(
    "launch",
    "launch file of static_transform_publisher",
    _launch,
    endings=(".py", ".xml"),
    needs_metres=True,
)
