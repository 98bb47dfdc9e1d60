"""`replay` publishes and plays: to a live node in the time of the bag, and in circles."""

from __future__ import annotations

import math
import re
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from diagnostic_msgs.msg import DiagnosticArray
from live import Client, LiveNode
from rosgraph_msgs.msg import Clock
from stcalib_ros.msg import CalibrationResult, CameraExtrinsics, TimeOffset
from stcalib_ros.srv import Recalibrate
from visualization_msgs.msg import MarkerArray

from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.bag_records import RawMessage
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.mocap import shipped_clips
from stcalib_ros.io.results import read_result
from stcalib_ros.ros import replay
from stcalib_ros.ros.player import timeline

N_FRAMES = 200
NAMES = ("cam0", "cam1", "cam2")


def simulated(path: Path, n_frames: int) -> Path:
    options = SceneOptions(n_cameras=3, n_people=2, n_frames=n_frames, seed=1)
    write_bag(simulate(options, clips=shipped_clips()).recording, path)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("replay")


@pytest.fixture(scope="module")
def bag(folder: Path) -> Path:
    return simulated(folder / "walk.mcap", N_FRAMES)


@pytest.fixture(scope="module")
def recording(bag: Path) -> Recording:
    return read_bag(bag)


@pytest.fixture(scope="module")
def offline(recording: Recording) -> Calibration:
    calibration = calibrate(recording)
    assert calibration.status is Status.OK
    return calibration


def played(folder: Path, bag: Path, *arguments: str, name: str = "replay") -> LiveNode:
    return LiveNode(folder, {}, name, executable="replay", arguments=[bag, *arguments])


def compare(result: CalibrationResult, offline: Calibration) -> None:
    assert (result.status, result.message) == (int(offline.status), offline.message)
    assert (result.n_observations, result.n_inliers) == (offline.n_observations, offline.n_inliers)
    assert [e.camera for e in result.extrinsics] == [c.name for c in offline.cameras]
    positions = [e.pose.pose.position for e in result.extrinsics]
    np.testing.assert_allclose(
        [[p.x, p.y, p.z] for p in positions], [c.t_ref_cam for c in offline.cameras], atol=1e-9
    )
    offsets = [offset.offset_s for offset in result.time_offsets]
    np.testing.assert_allclose(offsets, [c.time_offset_s for c in offline.cameras], atol=1e-9)
    frames = [offset.offset_frames for offset in result.time_offsets]
    np.testing.assert_allclose(frames, np.array(offsets) * 30.0, rtol=0.02)


def test_the_result_stays_published_until_interrupted(folder, bag, offline):
    output = folder / "published.yaml"
    live = played(folder, bag, "--output", str(output), "--publish", "--quiet")
    client = Client("replay")
    try:
        (result,) = client.latched(CalibrationResult, "result", 1)
        compare(result, offline)
        assert result.run_id == "replay-walk"
        assert result.header.stamp == result.window_end
        extrinsics = client.latched(CameraExtrinsics, "extrinsics", 3)
        assert [(e.camera, e.pose) for e in extrinsics] == [
            (e.camera, e.pose) for e in result.extrinsics
        ]
        assert len(client.latched(TimeOffset, "time_offsets", 3)) == 3
        (markers,) = client.latched(MarkerArray, "markers", 1)
        assert [m.text for m in markers.markers if m.ns == "names"] == ["cam0", "cam1", "cam2"]
        assert read_result(output).status is Status.OK
        client.wait(lambda: "until interrupted (Ctrl-C)" in live.log.read_text(), "that it is said")
        status, seconds = live.stop(signal.SIGINT)
        assert (status, seconds < 5.0) == (0, True)
        assert "Traceback" not in live.log.read_text()
    finally:
        live.kill()
        client.close()


def test_what_is_refused_is_not_published(folder):
    bag = simulated(folder / "short.mcap", 10)
    live = played(folder, bag, "--output", str(folder / "short.yaml"), "--publish", "--play")
    assert live.process.wait(timeout=60) == 3
    said = live.log.read_text().splitlines()
    assert said[-1].startswith("replay: no trustworthy calibration")
    assert not (folder / "short.yaml").exists()


class SimulatedTime(Client):
    """Client of a calibrator with ``use_sim_time``; keeps the stamps of /diagnostics."""

    def __init__(self, target: str) -> None:
        super().__init__(target)
        self.stamps: list[float] = []
        self.clock: list[float] = []
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._stamped, 10)
        self.node.create_subscription(Clock, "/clock", self._ticked, 100)

    def _stamped(self, array: DiagnosticArray) -> None:
        self.stamps.append(array.header.stamp.sec + array.header.stamp.nanosec * 1e-9)

    def _ticked(self, message: Any) -> None:
        self.clock.append(message.clock.sec + message.clock.nanosec * 1e-9)


@pytest.fixture(scope="module")
def calibrator(folder: Path) -> Iterator[LiveNode]:
    given = {
        "cameras": "[cam0, cam1, cam2]",
        "queue_depth": "1000",
        "auto_calibrate": "false",
        "use_sim_time": "true",
        "results_folder": str(folder / "results"),
    }
    live = LiveNode(folder, given, "simulated")
    yield live
    live.kill()


@pytest.fixture(scope="module")
def client(calibrator: LiveNode) -> Iterator[SimulatedTime]:
    client = SimulatedTime("simulated")
    yield client
    client.close()


def test_while_there_is_no_clock_the_node_answers_and_reports(client):
    """With stamps of zero, which is what the time is then."""
    client.wait(lambda: len(client.stamps) >= 2, "diagnostics")
    assert set(client.stamps) == {0.0}
    said = client.answer(Recalibrate, "recalibrate", wait=True)
    assert not said.accepted
    assert said.result.header.stamp.sec == 0
    assert math.isinf(float(client.status("camera cam0")["age_s"]))


def test_played_with_a_clock_the_live_node_finds_the_numbers_of_the_bag(
    client, folder, bag, recording, offline
):
    counts = {c.name: len(c.stamps) for c in recording.cameras}
    for _ in range(5):  # best effort may lose some, another time not
        player = played(folder, bag, "--play", "5", "--clock", "50", name="player")
        client.wait(lambda p=player: p.process.poll() is not None, "the end of the bag")
        assert player.process.returncode == 0, player.log.read_text()
        if client.images(counts) == counts and client.clock:
            break
    answer = client.answer(Recalibrate, "recalibrate", wait=True)
    compare(answer.result, offline)
    assert answer.result.header.stamp == answer.result.window_end
    stamps = np.concatenate([c.stamps for c in recording.cameras]) + recording.epoch_ns * 1e-9
    first, last = stamps.min() - 1e-6, stamps.max() + 1e-6
    assert first <= min(client.clock) <= max(client.clock) <= last
    assert np.median(np.diff(client.clock)) == pytest.approx(5.0 / 50.0, rel=1e-3)
    client.wait(lambda: first < client.stamps[-1] <= last, "stamps in the time of the bag")
    seen = len(client.stamps)
    client.wait(lambda: len(client.stamps) > seen + 1, "diagnostics while /clock stands still")


def test_when_the_bag_begins_again_the_node_forgets_and_calibrates_again(
    client, calibrator, folder, bag
):
    changed = client.change(auto_calibrate=True, min_motion_s=1.0, period_s=1.0)
    assert changed == [(True, "")] * 3
    client.next_diagnostics()
    flushes = {name: int(client.status(f"camera {name}")["flushes"]) for name in NAMES}
    player = played(folder, bag, "--play", "3", "--clock", "--loop", name="circles")

    def jumped_twice() -> bool:
        return all(
            int(client.status(f"camera {n}")["flushes"]) >= f + 2 for n, f in flushes.items()
        )

    try:
        # The node has data of before, so that the first jump is the beginning of the playing.
        client.wait(jumped_twice, "a bag that begins again")
        for _ in range(2):  # the first one may have begun before the jump
            last = client.status("solver")["last_run"]
            client.wait(lambda old=last: client.status("solver")["last_run"] != old, "another run")
        assert client.status("solver")["last_status"] == "OK"
        status, seconds = player.stop(signal.SIGTERM)
        assert (status, seconds < 5.0) == (0, True)
    finally:
        player.kill()
    log = calibrator.log.read_text()
    (line,) = re.findall("time begins again for .*", log)
    assert all(name in line for name in NAMES)
    assert "do two cameras publish on this topic?" not in log
    assert "again from its beginning: time jumps back" in player.log.read_text()
    assert calibrator.stop()[0] == 0
    assert "Traceback" not in log + player.log.read_text()


def test_a_topic_that_nobody_listens_to_is_named_and_played(folder, bag):
    lonely = played(folder, bag, "--play", "1000", "--wait", "0", name="lonely")
    assert lonely.process.wait(timeout=60) == 0
    said = lonely.log.read_text()
    assert "nobody subscribes to /cam0/person_poses, /cam0/camera_info" in said
    assert f"played {3 * N_FRAMES + 3 * 7} messages" in said


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        ([], "nothing to do"),
        (["--publish", "--play"], "add --output"),
        (["--play", "--report", "a.html"], "add --output"),
        (["--output", "a.yaml", "--clock"], "go with --play"),
        (["--output", "a.yaml", "--loop"], "go with --play"),
        (["--output", "a.yaml", "--wait", "1"], "go with --play"),
        (["--play", "0"], "0 is not above 0"),
        (["--play", "nan"], "nan is not above 0"),
        (["--play", "--clock", "-1"], "-1 is not above 0"),
        (["--play", "--wait", "-1"], "-1 is below 0"),
        (["--play", "fast"], "invalid"),
    ],
)
def test_arguments_that_do_not_go_together_say_why(monkeypatch, capsys, arguments, why):
    monkeypatch.setattr(sys, "argv", ["replay", "bag.mcap", *arguments])
    with pytest.raises(SystemExit) as stopped:
        replay.main()
    assert stopped.value.code == 2
    assert why in capsys.readouterr().err


def raw(log_time: int) -> RawMessage:
    return RawMessage("/topic", "type", log_time, b"", 0.0)


def test_ticks_come_between_the_messages_and_before_those_of_their_time():
    messages = [raw(t) for t in (100, 100, 125, 150)]
    events = [(t, m is None) for t, m in timeline(messages, 25)]
    assert events == [
        *((100, True), (100, False), (100, False)),
        *((125, True), (125, False), (150, True), (150, False)),
    ]


def test_time_never_goes_back_within_a_bag():
    messages = [raw(t) for t in (100, 300, 200, 400)]
    times = [t for t, _ in timeline(messages, 50)]
    assert times == sorted(times)
    assert [m for _, m in timeline(messages, None)] == messages
    assert list(timeline([], 50)) == []
