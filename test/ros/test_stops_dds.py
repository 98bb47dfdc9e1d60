"""Nodes in namespaces of their own, and nodes that are stopped in the middle of a solve."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from live import Client, LiveNode
from rclpy.action import ActionClient
from stcalib_ros.action import Calibrate
from stcalib_ros.msg import PersonPose3DArray
from std_msgs.msg import String

from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.mocap import shipped_clips

STAGES = [
    "assembly",
    "checking the input",
    "matching camera pairs",
    "joining all cameras",
    "first joint refinement",
    "joint refinement",
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("stops")


def said(client: Client, name: str) -> str:
    return client.status(f"camera {name}").get("message", "")


def number(client: Client, name: str, key: str) -> int:
    return int(client.status(f"camera {name}").get(key, -1))


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
            own = ["--ros-args", "--params-file", file]
            own += ["-r", f"cam1/people:=/{side}/cam1/elsewhere", "--"]
            lives.append(LiveNode(folder, {}, f"{side}/two", arguments=own))
            clients.append(Client(f"{side}/two"))
        a, b = clients
        wrong = b.node.create_publisher(String, "/b/cam0/person_poses", 10)
        for client, window_s in ((a, 11.0), (b, 12.0)):
            assert client.parameter("window_s").double_value == window_s
        poses = a.publisher(PersonPose3DArray, "/a/cam1/elsewhere")

        def arrived() -> bool:
            poses.publish(PersonPose3DArray(layout="for a"))
            return number(a, "cam1", "received") > 0

        a.wait(arrived, "a message to a")
        b.wait(lambda: "but nobody publishes a stcalib" in said(b, "cam0"), "the wrong type")
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
    bag = folder / "three.mcap"
    write_bag(simulate(options, clips=shipped_clips()).recording, bag)
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
def test_it_stops_cleanly_in_every_stage(ready_nodes, record_property, folder, k):
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
    record_property("stop_s", round(seconds, 3))
    assert status == 0
    assert solver, "it was in the middle of a solve"
    client.wait(lambda: not any(map(alive, solver)), "the end of the solver's process")
    assert "Traceback" not in live.log.read_text()
    assert not (folder / client.target).exists(), "nothing is written"
    if STAGES[k] == "joint refinement":
        assert np.isfinite(steps[-1].feedback.reprojection_rms_px)
    action.destroy()
