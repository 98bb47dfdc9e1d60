"""The table of messages in docs/formats.md: a bag of each type calibrates by its second command."""

from __future__ import annotations

import functools
import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from foreign_messages import MakeMessage, hiros, hri, kinect, write_foreign, yolo, zed

import stcalib_ros as st
from stcalib_ros.cli import main
from stcalib_ros.core.geometry.lens import project
from stcalib_ros.io.results import read_result

PAGE = Path(__file__).parents[3] / "docs" / "formats.md"
ROW = re.compile(
    r"^\| [^|]+ \| ((?:`\w+/msg/\w+`(?:, )?)+) \| `ros2 [^|]+`<br>`stcalib ([^`]+)` \|$"
)
COMMANDS = {
    kind: m[2]
    for line in PAGE.read_text().splitlines()
    if (m := ROW.match(line))
    for kind in re.findall(r"`([^`]+)`", m[1])
}
PUBLISHED: dict[str, tuple[str, str, MakeMessage]] = {
    "yolo_msgs/msg/DetectionArray": ("/{}/yolo/tracking", "/{}/camera_info", yolo),
    "zed_msgs/msg/ObjectsStamped": (
        "/{}/zed_node/body_trk/skeletons",
        "/{}/zed_node/left/color/rect/camera_info",
        zed(1),
    ),
    "visualization_msgs/msg/MarkerArray": (
        "/{}/body_tracking_data",
        "/{}/depth/camera_info",
        kinect,
    ),
    "hri_msgs/msg/Skeleton2D": (
        "/{}/humans/bodies/{id}/skeleton2d",
        "/{}/camera_info",
        hri,
    ),
    "hiros_skeleton_msgs/msg/SkeletonGroup": ("/{}/skeletons", "/{}/camera_info", hiros(3)),
}
OLDER = {"yolov8_msgs/msg/DetectionArray", "zed_interfaces/msg/ObjectsStamped"}
"""The same messages under the names that they had before."""

OPTIONS = st.SceneOptions(n_cameras=3, n_people=3, n_frames=120, drop_rate=0.0, seed=3)


@functools.cache
def scene() -> st.Recording:
    """People in metres before each camera, as a depth camera sees them, and their keypoints."""
    simulated = st.simulate(OPTIONS)
    cameras = []
    for c, camera in enumerate(simulated.recording.cameras):
        world = simulated.joints_world(simulated.exposures_s[c])
        joints = world @ simulated.rig.R_cam_world[c].T + simulated.rig.t_cam_world[c]
        pixels = project(joints, camera.intrinsics)
        inside = (np.abs(pixels - [960, 540]) < [960, 540]).all(-1, keepdims=True)
        frames = np.arange(len(camera.stamps))
        tracks = tuple(
            st.Track(p, frames, np.where(there, xy, np.nan), np.where(there, xyz, np.nan), score)
            for p, (xy, xyz, there) in enumerate(zip(pixels, joints, inside, strict=True))
            for score in [np.where(there[..., 0], 0.9, 0.0)]
        )
        cameras.append(replace(camera, tracks=tracks))
    return replace(simulated.recording, cameras=tuple(cameras))


def test_every_type_has_its_row_and_is_published_here() -> None:
    assert set(COMMANDS) == {*PUBLISHED, *OLDER, "stcalib_ros/msg/PersonPose3DArray"}


@pytest.mark.parametrize("kind", PUBLISHED)
def test_a_bag_of_it_calibrates(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    topic, info_topic, make = PUBLISHED[kind]
    bag = write_foreign(
        tmp_path / "a.mcap", scene(), kind=kind, topic=topic, info_topic=info_topic, make=make
    )
    words = shlex.split(COMMANDS[kind])
    assert main([str(bag) if word == "walk" else word for word in words]) == 0, (
        capsys.readouterr().err
    )
    errors = st.evaluate(read_result(Path("walk.yaml")), st.simulate(OPTIONS).truth, fps=30.0)
    assert errors.E_R < 2e-3
    assert errors.E_delta < 0.1
