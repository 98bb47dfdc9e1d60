"""Cameras that are late, stop, send nonsense or change, and strangers, over real DDS."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from builtin_interfaces.msg import Time
from live import Client, LiveNode
from rclpy.serialization import deserialize_message, serialize_message
from samples import poses_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo
from stcalib_ros.msg import CalibrationResult, PersonPose3D, PersonPose3DArray
from stcalib_ros.srv import Recalibrate, SaveCalibration
from std_srvs.srv import Trigger

from stcalib_ros.core.synthetic import Scene, SceneOptions, simulate
from stcalib_ros.io.bag_records import RawMessage
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.mocap import shipped_clips
from stcalib_ros.io.results import read_result

NAMES = ["good", "other", "late", "stops", "blind", "wrong", "zooms"]
LATE_S, STOPPED_S, ZOOMED_S, END_S = 20.0, 4.0, 8.0, 27.0
SPEED = 4.0
N_MALFORMED = 1000
GOOD_BYTES = serialize_message(poses_message())


@pytest.fixture(scope="module")
def scene() -> Scene:
    options = SceneOptions(
        n_cameras=len(NAMES), n_people=2, n_frames=round(10 * END_S), fps=10.0, seed=1
    )
    return simulate(options, clips=shipped_clips())


@pytest.fixture(scope="module")
def bag(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its cameras have the names of what will go wrong with them."""
    cameras = tuple(
        replace(camera, name=name)
        for camera, name in zip(scene.recording.cameras, NAMES, strict=True)
    )
    path = tmp_path_factory.mktemp("bag") / "walk.mcap"
    write_bag(replace(scene.recording, cameras=cameras), path)
    return path


class Mischief:
    """What the cameras send in place of what is in the bag."""

    def __init__(self) -> None:
        self.begin: int | None = None

    def __call__(self, raw: RawMessage) -> Any:
        self.begin = raw.log_time if self.begin is None else self.begin
        now_s = (raw.log_time - self.begin) * 1e-9
        name, poses = raw.topic.split("/")[1], raw.topic.endswith("poses")
        if (name == "late" and now_s < LATE_S) or (name == "stops" and now_s > STOPPED_S):
            return None
        if name == "zooms" and now_s > ZOOMED_S:
            return halved(raw.data, poses=poses)
        if poses and name == "blind":
            return without_numbers(raw.data)
        if poses and name == "wrong":
            message = deserialize_message(raw.data, PersonPose3DArray)
            message.layout = "body_25"
            return message
        return raw.data


def halved(data: bytes, *, poses: bool) -> Any:
    """A driver that has been set to half the resolution."""
    if poses:
        message = deserialize_message(data, PersonPose3DArray)
        for person in message.persons:
            person.keypoints = 0.5 * np.array(person.keypoints)
        return message
    info = deserialize_message(data, CameraInfo)
    info.width, info.height = info.width // 2, info.height // 2
    info.k = np.append(0.5 * np.array(info.k[:8]), 1.0)
    return info


def without_numbers(data: bytes) -> Any:
    message = deserialize_message(data, PersonPose3DArray)
    for person in message.persons:
        person.keypoints = np.full(len(person.keypoints), np.nan)
        person.joints = np.full(len(person.joints), np.nan)
    return message


@pytest.fixture(scope="module")
def played(
    bag: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[LiveNode, Client, dict[str, dict[str, str]]]]:
    """A node to which all was played, somebody who asks it, and what it said right after."""
    folder = tmp_path_factory.mktemp("hostile")
    given = {
        "cameras": f"[{', '.join(NAMES)}]",
        "queue_depth": "1000",
        "auto_calibrate": "false",
        "watch": "false",
        "offset_range_s": "0.5",
        "registration.n_refined": "2",
        "integration.n_trees": "50",
        "bundle.rounds": "3",
        "results_folder": str(folder / "results"),
    }
    live = LiveNode(folder, given, "hostile")
    client = Client("hostile")
    try:
        client.next_diagnostics()
        client.play(bag, speed=SPEED, sent=Mischief())
        client.next_diagnostics()
        yield live, client, {name: dict(client.status(f"camera {name}")) for name in NAMES}
        assert live.stop(signal.SIGINT)[0] == 0
        assert "Traceback" not in live.log.read_text()
    finally:
        live.kill()
        client.close()


@pytest.fixture(scope="module")
def result(played: Any) -> CalibrationResult:
    """What is found from it; others are answered meanwhile."""
    _, client, _ = played
    future = client.ask(Recalibrate, "recalibrate", wait=True)
    client.wait(lambda: client.status("solver").get("state") == "running", "a run")
    saved = client.answer(SaveCalibration, "save", path="early.yaml")
    assert (saved.success, "no calibration to save yet" in saved.message) == (False, True)
    assert not client.answer(Trigger, "rollback").success
    assert client.change(seed=1, window_s=60.0) == [(True, "")] * 2
    assert not future.done()
    return client.result_of(future, "the end of the run").result


def test_each_camera_says_what_is_wrong_with_it(played):
    live, _, said = played
    for name in ("good", "other", "late"):
        assert said[name]["message"] == "receiving", name
    assert int(said["late"]["images"]) < 0.5 * int(said["good"]["images"])
    assert re.match(r"waits for poses, the last came \d+ s ago: ", said["stops"]["message"])
    assert "people without keypoints" in said["blind"]["message"]
    assert said["wrong"]["images"] == "0"
    assert said["wrong"]["dropped"] == said["wrong"]["received"]
    assert "body_25" in said["wrong"]["message"]
    assert said["zooms"]["flushes"] == "1"
    log = live.log.read_text()
    assert "/zooms/camera_info: CameraInfo changes: width was" in log
    assert "images received before are discarded" in log


def test_all_that_can_be_calibrated_are(result, scene):
    assert result.status == CalibrationResult.OK, result.message
    found = {e.camera: e.pose.pose.orientation for e in result.extrinsics}
    assert sorted(found) == sorted({"good", "other", "late", "stops", "zooms"})
    truth = dict(zip(NAMES, scene.truth.cameras, strict=True))
    for name, q in found.items():
        turned = Rotation.from_matrix(truth[name].R_ref_cam).inv()
        error = turned * Rotation.from_quat([q.x, q.y, q.z, q.w])
        assert np.degrees(error.magnitude()) < 2.0, name


def test_a_thousand_malformed_messages_are_counted_and_do_no_harm(played, result):
    live, client, _ = played
    client.next_diagnostics()
    before, lost = client.status("camera good"), int(client.status("load")["lost"])
    memory_mb = resident_mb(live)
    rng = np.random.default_rng(0)
    topics = {PersonPose3DArray: "/good/person_poses", CameraInfo: "/good/camera_info"}
    n_poses = 0
    for k in range(N_MALFORMED):
        kind, message = malformed(rng, k)
        n_poses += kind is PersonPose3DArray
        client.publisher(kind, topics[kind]).publish(message)
        client.executor.spin_once(timeout_sec=0.002)

    def arrived() -> int:
        received = int(client.status("camera good")["received"]) - int(before["received"])
        return received + int(client.status("load")["lost"]) - lost

    client.wait(lambda: arrived() >= n_poses, "all that were sent")
    after = client.status("camera good")
    dropped = int(after["dropped"]) - int(before["dropped"])
    assert dropped >= 0.8 * N_MALFORMED
    assert int(after["images"]) >= int(before["images"])
    assert (after["flushes"], after["camera_info"]) == (before["flushes"], "true")
    assert resident_mb(live) < memory_mb + 50.0
    assert len(live.log.read_text().splitlines()) < 200
    assert client.answer(SaveCalibration, "save", path="after.yaml").success


def malformed(rng: np.random.Generator, k: int) -> tuple[type, Any]:
    """In turn: persons of random sizes and numbers, random bytes, and a damaged message."""
    kind = PersonPose3DArray if k % 4 else CameraInfo
    if k % 3 == 0:
        return kind, rng.bytes(int(rng.integers(0, 2000)))
    if k % 3 == 1:
        damaged = bytearray(GOOD_BYTES)
        at = 4 * int(rng.integers(3, len(damaged) // 4))
        damaged[at : at + 4] = rng.choice([2**31, 2**32 - 1, 10**8]).item().to_bytes(4, "little")
        return kind, bytes(damaged[: int(rng.integers(at, len(damaged)))])
    return PersonPose3DArray, odd_persons(rng)


def odd_persons(rng: np.random.Generator) -> PersonPose3DArray:
    message = poses_message()
    message.header.stamp = Time(sec=int(rng.integers(-(2**31), 2**31)))
    message.layout = str(rng.choice(["h36m_17", "no_such", "", "x" * 5000]))
    message.joint_names = ["n" * int(n) for n in rng.integers(0, 100, rng.integers(0, 200))]

    def numbers() -> np.ndarray:
        chosen = rng.choice([np.nan, np.inf, -np.inf, 1e30, 0.0], rng.integers(0, 400))
        return chosen.astype(np.float32)

    message.persons = [
        PersonPose3D(
            track_id=int(rng.integers(0, 2**31)),
            score=float(rng.choice([np.nan, -1.0, 1e30])),
            joints=numbers(),
            keypoints=numbers(),
            joint_scores=numbers(),
        )
        for _ in range(int(rng.integers(0, 60)))
    ]
    return message


def resident_mb(live: LiveNode) -> float:
    pages = int(Path(f"/proc/{live.process.pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def test_killed_while_it_saves_the_file_is_whole(played, result):
    """Nodes that have the calibration of before in force, killed at random times amid saves."""
    live, _, _ = played
    assert live.process.poll() is None
    mine = live.log.parent / "results" / "mine.yaml"
    rng = np.random.default_rng(0)
    for k in range(3):
        other = LiveNode(live.log.parent, live.given, f"killed{k}")
        asking = Client(f"killed{k}")
        try:
            assert asking.answer(SaveCalibration, "save", path="mine.yaml").success
            expected = mine.read_text()
            assert len(read_result(mine).cameras) == 5
            pending = [asking.ask(SaveCalibration, "save", path="mine.yaml") for _ in range(9)]
            until = int(rng.integers(1, 9))
            asking.wait(lambda p=pending, n=until: sum(f.done() for f in p) >= n, "saves")
            other.kill()
            assert other.process.returncode == -signal.SIGKILL
        finally:
            other.kill()
            asking.close()
        assert mine.read_text() == expected
