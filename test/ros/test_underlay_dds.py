"""Messages of other packages over real DDS, by the classes of those packages."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

import foreign_messages as foreign
import foreign_talker
from bag_helpers import write_bag
from live import TIMEOUT_S, Client, LiveNode
from stcalib_ros.srv import Recalibrate

from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.mocap import shipped_clips

SENDERS = {
    "cam0": ("yolo_msgs/msg/DetectionArray", "/{}/yolo/tracking", foreign.yolo),
    "cam1": ("zed_msgs/msg/ObjectsStamped", "/{}/zed_node/body_trk/skeletons", foreign.zed(0)),
    "cam2": ("hri_msgs/msg/Skeleton2D", "/{}/humans/bodies/b{id}/skeleton2d", foreign.hri),
}
N_NOBODY = 10
"""Images of the last camera in which there is nobody yet."""
N_WAITING = 15
"""Its last images, of half a second, wait for other persons."""
POSITION_M = 0.02
"""The live window ends half a second earlier for the camera with a topic for each person."""


def parameters(folder: Path) -> dict[str, str]:
    given = {
        "cameras": f"[{', '.join(SENDERS)}]",
        "queue_depth": "1000",
        "auto_calibrate": "false",
        "results_folder": str(folder / "results"),
    }
    for name, (kind, topic, _) in SENDERS.items():
        given[f"camera.{name}.pose_type"] = kind
        given[f"camera.{name}.pose_topic"] = topic.replace("b{id}", "*").format(name)
    return given


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three cameras, of which each has the messages of another package."""
    scene = SceneOptions(n_cameras=3, n_people=2, n_frames=240, seed=1)
    recording = simulate(scene, clips=shipped_clips()).recording
    recording = replace(
        recording, cameras=(*recording.cameras[:2], later(recording.cameras[2], N_NOBODY))
    )
    messages = foreign.hri_ids(
        replace(recording, cameras=recording.cameras[2:]), "/{}/humans/bodies/tracked"
    )
    for camera in recording.cameras:
        kind, topic, make = SENDERS[camera.name]
        one = replace(recording, cameras=(camera,))
        messages += foreign.foreign_messages(
            one, kind=kind, topic=topic, info_topic="/{}/camera_info", make=make
        )
    return write_bag(tmp_path_factory.mktemp("others") / "a.mcap", messages)


def later(camera: CameraRecording, n: int) -> CameraRecording:
    """The same camera without the people of its first n images."""
    tracks = []
    for track in camera.tracks:
        seen = track.frames >= n
        arrays = {f: getattr(track, f)[seen] for f in ("frames", "keypoints", "joints", "scores")}
        tracks.append(replace(track, **arrays))
    return replace(camera, tracks=tuple(tracks))


@pytest.fixture(scope="module")
def recording(bag: Path) -> Recording:
    return read_bag(bag)


@pytest.fixture(scope="module")
def offline(recording: Recording) -> Calibration:
    return calibrate(recording)


@pytest.fixture
def live(setup_file: Path, tmp_path: Path) -> Iterator[LiveNode]:
    node = LiveNode(tmp_path, parameters(tmp_path), "others", setup_file=setup_file)
    yield node
    node.kill()


def test_a_list_of_ids_says_which_images_have_nobody(recording):
    first = [min(int(track.frames[0]) for track in c.tracks) for c in recording.cameras]
    assert [len(c.stamps) for c in recording.cameras] == [240, 240, 240]
    assert first[2] >= N_NOBODY > first[0]


@pytest.mark.slow
def test_three_packages_give_one_calibration(setup_file, live, bag, recording, offline):
    client = Client("others")
    counts = {camera.name: len(camera.stamps) for camera in recording.cameras}
    counts["cam2"] -= N_WAITING
    sourcing = ["bash", "-c", f'source "{setup_file}"; exec "$@"', "bash", sys.executable]
    talking = [*sourcing, foreign_talker.__file__, "others", bag, json.dumps(counts)]
    try:
        done = subprocess.run(
            talking, capture_output=True, text=True, timeout=TIMEOUT_S, check=False
        )
        assert done.returncode == 0, done.stderr
        client.next_diagnostics()
        assert all(client.status(f"camera {name}")["dropped"] == "0" for name in SENDERS)
        result = client.answer(Recalibrate, "recalibrate", wait=True).result
        assert (offline.status, result.status) == (Status.OK, int(Status.OK)), result.message
        for camera, extrinsics in zip(offline.cameras, result.extrinsics, strict=True):
            p = extrinsics.pose.pose.position
            np.testing.assert_allclose([p.x, p.y, p.z], camera.t_ref_cam, atol=POSITION_M)
        assert live.stop()[0] == 0
    finally:
        client.close()


def test_a_package_that_is_missing_is_named_with_its_command(tmp_path):
    if importlib.util.find_spec("zed_msgs") is not None:
        pytest.skip("zed_msgs is installed")
    kind = SENDERS["cam1"][0]
    given = {"cameras": "[cam0, cam1]", "camera.cam1.pose_type": kind}
    live = LiveNode(tmp_path, given, "missing")
    try:
        assert live.process.wait(timeout=TIMEOUT_S) == 2
    finally:
        live.kill()
    assert live.log.read_text() == (
        f"calibrator: no message {kind!r} here: install and source the package 'zed_msgs': "
        "apt install ros-$ROS_DISTRO-zed-msgs\n"
    )
