"""A camera is turned while the live node runs: it says so, and calibrates again."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from live import Client, LiveNode

from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.recording import excerpt
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.synthetic import CameraChange, SceneOptions, simulate
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.history import History
from stcalib_ros.io.mocap import shipped_clips

CAMERAS = ["cam0", "cam1", "cam2"]
CALIBRATED_S, CHANGED_S, END_S = 10.0, 15.0, 32.0
TURN_DEG = 2.0


class Ear:
    """Everything that the diagnostics say of the cameras, in order."""

    def __init__(self, client: Client) -> None:
        self.client = client
        self.heard: list[tuple[str, bytes, str, dict[str, str]]] = []
        client.node.create_subscription(DiagnosticArray, "/diagnostics", self._hear, 10)

    def _hear(self, array: DiagnosticArray) -> None:
        for s in array.status:
            target, _, part = s.name.partition(": ")
            if target == self.client.target and part.startswith("camera "):
                values = {v.key: v.value for v in s.values}
                self.heard.append((part[7:], s.level, s.message, values))

    def alarms(self) -> list[tuple[str, bytes, str, dict[str, str]]]:
        return [h for h in self.heard if h[1] == DiagnosticStatus.ERROR and "wait" not in h[2]]


@pytest.fixture(scope="module")
def before(tmp_path_factory: pytest.TempPathFactory) -> tuple[Calibration, Path]:
    """Calibration of before the change, and a bag of what came after it."""
    options = SceneOptions(n_cameras=3, n_people=3, n_frames=round(30 * END_S), seed=1)
    turn = (0.0, np.radians(TURN_DEG), 0.0)
    scene = simulate(
        options, clips=shipped_clips(), changes=[CameraChange(1, CHANGED_S, turn_rad=turn)]
    )
    calibration = calibrate(excerpt(scene.recording, 0.0, CALIBRATED_S))
    assert calibration.status is Status.OK, calibration.message
    bag = tmp_path_factory.mktemp("bag") / "turned.mcap"
    write_bag(excerpt(scene.recording, CALIBRATED_S, END_S), bag)
    return calibration, bag


@pytest.fixture(scope="module")
def played(
    before: tuple[Calibration, Path], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[LiveNode, Client, Ear, Path]]:
    """A node that had the calibration in force while the bag was played."""
    calibration, bag = before
    folder = tmp_path_factory.mktemp("watch")
    History(folder / "results", keep=10).add(calibration)
    given = {
        "cameras": f"[{', '.join(CAMERAS)}]",
        "queue_depth": "1000",
        "results_folder": str(folder / "results"),
        "min_motion_s": "6.0",
        "auto_calibrate": "false",
        "auto_recalibrate": "true",
    }
    live = LiveNode(folder, given, "watching")
    client = Client("watching")
    ear = Ear(client)
    try:
        client.next_diagnostics()
        client.play(bag, speed=2.5)
        yield live, client, ear, folder
        assert live.stop(signal.SIGINT)[0] == 0
        assert "Traceback" not in live.log.read_text()
    finally:
        live.kill()
        client.close()


def test_it_says_which_camera_has_moved_and_by_how_much(played):
    live, client, ear, _ = played
    client.wait(lambda: "cam1 has moved" in live.log.read_text(), "the alarm")
    name, level, message, values = ear.alarms()[0]
    assert (name, level) == ("cam1", DiagnosticStatus.ERROR)
    assert message.startswith("cam1 has moved, as if turned by")
    assert values["watch"] == "moved"
    assert float(values["watch_rotation_deg"]) == pytest.approx(TURN_DEG, abs=0.7)
    assert abs(float(values["watch_clock_ms"])) < 30.0
    assert float(values["watch_residual_px"]) > 0.0
    assert {h[0] for h in ear.alarms()} == {"cam1"}
    assert any(h[0] == "cam1" and h[3]["watch"] == "ok" for h in ear.heard)
    assert "calibrating again as soon as people have moved" in live.log.read_text()


def test_it_calibrates_again_from_what_came_after(played, before):
    live, client, _, folder = played
    client.wait(lambda: client.status("solver").get("last_status") == "OK", "a run")
    text = live.log.read_text()
    assert "in force, since the one in force is wrong: cam1 has moved" in text
    old, kept = before[0], History(folder / "results", keep=10).latest(lambda _: None).kept
    assert kept is not None
    new = kept.calibration
    angles = {pair: np.degrees(turned(old, new, pair)) for pair in ((0, 1), (0, 2), (1, 2))}
    assert angles[0, 2] < 0.3
    assert angles[0, 1] == pytest.approx(TURN_DEG, abs=0.3)
    assert angles[1, 2] == pytest.approx(TURN_DEG, abs=0.3)
    changed_s = old.epoch_s + CHANGED_S
    assert new.window_s[0] > changed_s - 0.1


def test_it_can_be_switched_off_and_on(played):
    _, client, _, _ = played

    assert client.change(watch=False) == [(True, "")]
    client.wait(lambda: client.status("camera cam1")["watch"] == "off", "the end of the watch")
    assert client.change(watch=True) == [(True, "")]
    client.wait(lambda: client.status("camera cam1")["watch"] != "off", "the watch")
    assert "has moved" not in client.status("camera cam1")["message"]


def turned(old: Calibration, new: Calibration, pair: tuple[int, int]) -> float:
    """Angle by which two cameras have turned against each other, rad."""
    relative = [c.cameras[pair[0]].R_ref_cam.T @ c.cameras[pair[1]].R_ref_cam for c in (old, new)]
    return float(rotation_angle(relative[0].T @ relative[1]))
