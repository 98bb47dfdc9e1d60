"""Cameras that come late, stop, send nothing of use or change; strangers; and stops at any time."""

from __future__ import annotations

import signal
import struct
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from live import LATCHED, Client, LiveNode
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.action import ActionClient
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import CameraInfo
from stcalib_ros.action import Calibrate
from stcalib_ros.msg import CalibrationResult, PersonPose3DArray
from stcalib_ros.srv import Recalibrate, SaveCalibration
from std_msgs.msg import String
from std_srvs.srv import Trigger

from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.core.types import Recording
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.bag_writer import write_recording
from stcalib_ros.io.mcap_source import RawMessage, raw_messages
from stcalib_ros.io.mocap import shipped_clips

GOOD, LATE, BLIND, WRONG, STOPS, LENS = (f"cam{i}" for i in range(6))
NAMES = [GOOD, LATE, BLIND, WRONG, STOPS, LENS]
FPS, LATE_S, STOP_S, LENS_S, END_S = 15.0, 20.0, 12.0, 10.0, 30.0
STAGES = [
    "assembly",
    "lift",
    "pairwise registration",
    "integration",
    "first adjustment",
    "bundle adjustment",
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("faults")


def written(path: Path, options: SceneOptions) -> Path:
    write_recording(simulate(options, clips=shipped_clips()).recording, path)
    return path


@pytest.fixture(scope="module")
def bag(folder: Path) -> Path:
    options = SceneOptions(n_cameras=6, n_people=2, n_frames=round(FPS * END_S), fps=FPS, seed=1)
    return written(folder / "six.mcap", options)


@pytest.fixture(scope="module")
def recording(bag: Path) -> Recording:
    return read_bag(bag)


def faulty(begin_ns: int, raw: RawMessage) -> bytes | None:
    """What becomes of a message of a flawless bag."""
    camera, at_s = raw.topic.split("/")[1], (raw.log_time - begin_ns) * 1e-9
    is_info = raw.topic.endswith("camera_info")
    late, stopped = camera == LATE and at_s < LATE_S, camera == STOPS and at_s > STOP_S
    if late or stopped or (is_info and camera == GOOD):
        return None
    if is_info and camera == LENS and at_s > LENS_S:
        info = deserialize_message(raw.data, CameraInfo)
        # The same lens in other words, so that it still calibrates.
        info.distortion_model, info.d = "rational_polynomial", [*info.d[:5], 0.0, 0.0, 0.0]
        return bytes(serialize_message(info))
    if not is_info and camera in (BLIND, WRONG):
        poses = deserialize_message(raw.data, PersonPose3DArray)
        poses.layout = "no_such_layout" if camera == WRONG else poses.layout
        for person in poses.persons if camera == BLIND else ():
            person.keypoints = np.full(len(person.keypoints), np.nan, dtype=np.float32)
            person.joints = np.full(len(person.joints), np.nan, dtype=np.float32)
        return bytes(serialize_message(poses))
    return raw.data


@pytest.fixture(scope="module")
def client(folder: Path, bag: Path) -> Iterator[Client]:
    """Client of a node that has been played the bag with all its faults.

    One CameraInfo was sent before the node was there, and latched.
    """
    begin_ns = min(m.log_time for m in raw_messages([bag], frozenset({"/cam0/person_poses"})))
    client = Client("tried")
    latched = client.node.create_publisher(CameraInfo, f"/{GOOD}/camera_info", LATCHED)
    first = next(iter(raw_messages([bag], frozenset({f"/{GOOD}/camera_info"}))))
    latched.publish(first.data)
    given = {
        "cameras": f"[{', '.join(NAMES)}]",
        "queue_depth": "1000",
        "auto_calibrate": "false",
        "results_folder": str(folder / "results"),
    }
    live = LiveNode(folder, given, "tried")
    try:
        client.play(bag, speed=8.0, edit=partial(faulty, begin_ns))
        yield client
        assert live.process.poll() is None
        status, _ = live.stop()
        assert status == 0
        assert "Traceback" not in live.log.read_text()
    finally:
        live.kill()
        client.close()


def said(client: Client, name: str) -> str:
    return client.status(f"camera {name}").get("message", "")


def number(client: Client, name: str, key: str) -> int:
    return int(client.status(f"camera {name}").get(key, -1))


def test_every_fault_is_said(client):
    client.wait(lambda: "the last came" in said(client, STOPS), "a camera that stopped")
    assert "by /client_of_tried (stcalib_ros/msg/Person" in said(client, STOPS)
    assert "no_such_layout" in client.status(f"camera {WRONG}")["last_problem"]
    assert number(client, WRONG, "dropped") == number(client, WRONG, "received") > 300
    assert number(client, WRONG, "images") == 0
    assert number(client, BLIND, "moving_s") == 0
    assert number(client, BLIND, "persons") > 300
    client.wait(lambda: number(client, LENS, "flushes") == 1, "the change of the lens")
    problem = client.status(f"camera {LENS}")["last_problem"]
    assert "CameraInfo changes: distortion_model was" in problem


def test_what_is_kept_is_what_came_of_use(client):
    client.wait(lambda: number(client, LENS, "flushes") == 1, "the change of the lens")
    shares = {GOOD: END_S, LATE: END_S - LATE_S, STOPS: STOP_S, LENS: END_S - LENS_S}
    for name, seconds in shares.items():
        assert number(client, name, "images") == pytest.approx(seconds * FPS, abs=2 * FPS), name
    assert client.status(f"camera {GOOD}")["camera_info"] == "true", "latched before the node was"


def test_the_others_are_calibrated(client, recording):
    future = client.ask(Recalibrate, "recalibrate", wait=True)
    client.wait(lambda: client.status("solver").get("state") == "running", "a run")
    assert not client.answer(SaveCalibration, "save", path="early.yaml").success
    values = client.answer(GetParameters, "get_parameters", names=["window_s"]).values
    assert [v.double_value for v in values] == [30.0]
    result = client.result_of(future, "the end of the run").result
    assert result.status == CalibrationResult.OK, result.message
    assert {e.camera for e in result.extrinsics} == {GOOD, LATE, STOPS, LENS}
    assert f"{BLIND}: " in result.message


def test_from_one_that_could_not_be_saved_the_way_back_is_to_the_last_file(client, folder):
    results, away = folder / "results", folder / "away"
    results.rename(away)
    results.touch()
    answer = client.answer(Recalibrate, "recalibrate", wait=True)
    assert answer.result.status == CalibrationResult.OK, answer.result.message
    client.wait(lambda: client.status("solver")["in_force"] == answer.run_id, "the new one")
    assert "not saved: cannot make" in client.status("solver")["last_message"]
    results.unlink()
    away.rename(results)
    said = client.answer(Trigger, "rollback")
    assert (said.success, said.message) == (True, "calibration 1 is in force again")
    assert [path.name for path in results.iterdir()] == ["calibration.000001.yaml"]
    (result,) = client.latched(CalibrationResult, "result", 1)
    assert result.run_id == "saved-000001"
    assert not client.answer(Trigger, "rollback").success


def malformed(rng: np.random.Generator, good: bytes) -> bytes:
    """A message that is broken in one of many ways."""
    kind = rng.integers(6)
    if kind == 0:
        return good[:4] + rng.bytes(int(rng.integers(0, 600)))
    if kind == 1:
        return good[: int(rng.integers(0, len(good)))]
    if kind == 2:
        at = int(rng.integers(1, len(good) // 4)) * 4
        count = int(rng.choice([2**32 - 1, 2**31, 3_000_000, 70_000]))
        return good[:at] + struct.pack("<I", count) + good[at + 4 :]
    message = deserialize_message(good, PersonPose3DArray)
    if kind == 3:
        message.persons = list(message.persons) * int(rng.integers(30, 200))
    elif kind == 4:
        message.layout = "".join(chr(c) for c in rng.integers(1, 0xD000, rng.integers(1, 400)))
    for person in message.persons:
        values = rng.choice([np.nan, np.inf, 1e38, 0.0], size=rng.integers(0, 200))
        person.keypoints = values.astype(np.float32)
    message.header.stamp.sec = int(rng.integers(-(2**31), 2**31))
    return bytes(serialize_message(message))


def test_a_thousand_malformed_messages_empty_no_buffer(client, bag):
    """While the camera goes on: raw bytes that are none of our messages among them."""
    rng = np.random.default_rng(0)
    topic = f"/{GOOD}/person_poses"
    *_, last = raw_messages([bag], frozenset({topic}))
    message = deserialize_message(last.data, PersonPose3DArray)
    publisher = client.publisher(PersonPose3DArray, topic)
    client.next_diagnostics()
    before = {k: number(client, GOOD, k) for k in ("received", "dropped", "flushes")}
    begin_s = message.header.stamp.sec + 1
    for k in range(1000):
        publisher.publish(malformed(rng, last.data))
        if k % 20 == 0:
            seconds, half = divmod(k // 20, 2)
            message.header.stamp.sec = begin_s + seconds
            message.header.stamp.nanosec = 500_000_000 * half
            publisher.publish(message)
            client.executor.spin_once(timeout_sec=0.02)
    client.wait(lambda: number(client, GOOD, "received") > before["received"] + 700, "messages")
    client.next_diagnostics()
    assert number(client, GOOD, "dropped") > before["dropped"] + 500
    assert number(client, GOOD, "flushes") == before["flushes"]
    assert client.status("solver")["in_force"]


def test_parameters_change_at_run_time_or_say_why_not(client):
    def change(name: str, value: object) -> tuple[bool, str]:
        parameters = [Parameter(name, value=value).to_parameter_msg()]
        (result,) = client.answer(SetParameters, "set_parameters", parameters=parameters).results
        return result.successful, result.reason

    assert change("window_s", 20.0) == (True, "")
    client.wait(lambda: number(client, STOPS, "images") >= 0, "diagnostics")
    client.wait(lambda: number(client, GOOD, "images") < 23 * FPS, "a shorter window")
    for name, value, why in [
        ("window_s", 1.0, "range"),
        ("window_s", "long", "type"),
        ("max_mb", 0.0, "range"),
        ("max_persons", 0, "range"),
        ("queue_depth", 7, "read-only"),
        ("results_folder", "/", "read-only"),
        ("camera.cam0.pose_topic", "/x", "read-only"),
        ("no_such", 1, "undeclared"),
    ]:
        successful, reason = change(name, value)
        assert not successful, name
        assert why in reason.lower(), reason


def test_two_calibrators_in_two_namespaces(folder, monkeypatch):
    """Relative topics, a remapped one, and one file of parameters for both."""
    monkeypatch.setenv("ROS_HOME", str(folder / "home"))
    file = folder / "both.yaml"
    file.write_text(
        "/**:\n  ros__parameters:\n    cameras: [cam0, cam1]\n    window_s: 11.0\n"
        "    camera: {cam0: {pose_topic: cam0/person_poses}, cam1: {pose_topic: cam1/people}}\n"
        "/b/two:\n  ros__parameters:\n    window_s: 12.0\n"
    )
    lives, clients = [], []
    try:
        for side in "ab":
            own = ["--ros-args", "--params-file", file, "-r", f"__ns:=/{side}"]
            own += ["-r", f"cam1/people:=/{side}/cam1/elsewhere", "--"]
            (folder / side).mkdir()
            lives.append(LiveNode(folder / side, {}, "two", arguments=own))
            clients.append(Client(f"{side}/two"))
        a, b = clients
        wrong = b.node.create_publisher(String, "/b/cam0/person_poses", 10)
        for client, window_s in ((a, 11.0), (b, 12.0)):
            (value,) = client.answer(GetParameters, "get_parameters", names=["window_s"]).values
            assert value.double_value == window_s
        poses = a.publisher(PersonPose3DArray, "/a/cam1/elsewhere")
        unreadable = PersonPose3DArray(layout="for a")
        poses.publish(unreadable)
        a.wait(lambda: number(a, "cam1", "received") == 1, "the message to a")
        b.wait(lambda: "nobody publishes a stcalib" in said(b, "cam0"), "the wrong type")
        assert "(std_msgs/msg/String, RELIABLE, VOLATILE), but" in said(b, "cam0")
        assert "nobody publishes on /b/cam1/elsewhere" in said(b, "cam1")
        assert number(b, "cam1", "received") == 0
        assert wrong.get_subscription_count() == 0
        assert [live.stop()[0] for live in lives] == [0, 0]
    finally:
        for live in lives:
            live.kill()
        for client in clients:
            client.close()


def children(pid: int) -> list[int]:
    path = Path(f"/proc/{pid}/task/{pid}/children")
    tasks = Path(f"/proc/{pid}/task").glob("*/children") if path.exists() else ()
    return [int(child) for task in tasks for child in task.read_text().split()]


def alive(pid: int) -> bool:
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False


@pytest.fixture(scope="module")
def ready_nodes(folder: Path) -> Iterator[tuple[list[LiveNode], Client]]:
    """As many nodes as there are stages, each with all that it needs to calibrate."""
    options = SceneOptions(n_cameras=3, n_people=2, n_frames=150, seed=1)
    bag = written(folder / "three.mcap", options)
    lives = []
    for k in range(len(STAGES)):
        given = {
            "cameras": "[cam0, cam1, cam2]",
            "auto_calibrate": "false",
            "queue_depth": "1000",
            "results_folder": str(folder / f"stopped{k}"),
        }
        lives.append(LiveNode(folder, given, f"stopped{k}"))
    client = Client("stopped0")
    try:
        for k in range(len(STAGES)):
            client.target = f"stopped{k}"
            client.next_diagnostics()
        for n in range(3):
            publisher = client.publisher(PersonPose3DArray, f"/cam{n}/person_poses")
            client.wait(lambda p=publisher: p.get_subscription_count() >= len(STAGES), "nodes")
        client.play(bag, speed=3.0)
        yield lives, client
    finally:
        for live in lives:
            live.kill()
        client.close()


@pytest.mark.parametrize("k", range(len(STAGES)), ids=STAGES)
def test_it_stops_cleanly_in_every_stage(ready_nodes, folder, k):
    lives, client = ready_nodes
    live, steps = lives[k], []
    client.target = f"stopped{k}"
    action = ActionClient(client.node, Calibrate, f"/{client.target}/calibrate")
    client.wait(action.server_is_ready, "the action")
    sent = action.send_goal_async(Calibrate.Goal(), feedback_callback=steps.append)
    client.result_of(sent, "the goal's answer")
    if STAGES[k] == "assembly":
        client.wait(lambda: bool(children(live.process.pid)), "the solver's process")
    else:
        later = STAGES[k:]
        client.wait(lambda: any(s.feedback.stage in later for s in steps), "the stage")
    solver = children(live.process.pid)
    status, seconds = live.stop((signal.SIGINT, signal.SIGTERM)[k % 2])
    print(f"{STAGES[k]}: stopped within {seconds:.2f} s")
    assert status == 0
    assert solver, "it was in the middle of a solve"
    client.wait(lambda: not any(map(alive, solver)), "the end of the solver's process")
    assert "Traceback" not in live.log.read_text()
    assert not (folder / client.target).exists(), "nothing is written"
    if STAGES[k] == "bundle adjustment":
        assert np.isfinite(steps[-1].feedback.reprojection_rms_px)
    action.destroy()
