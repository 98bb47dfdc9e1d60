"""Drivers without a calibration, over real DDS: their lenses are found and handed over."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from live import Client, LiveNode
from sensor_msgs.msg import CameraInfo
from sensor_msgs.srv import SetCameraInfo
from stcalib_ros.msg import CalibrationResult
from stcalib_ros.srv import Recalibrate, SaveCalibration
from std_srvs.srv import Trigger

from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.recording import unknown_intrinsics
from stcalib_ros.core.synthetic import Scene, SceneOptions, simulate
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.camera_info_yaml import read_camera_info_yaml
from stcalib_ros.io.history import History
from stcalib_ros.io.mocap import shipped_clips

CAMERAS = ["cam0", "cam1", "cam2", "cam3"]
EARLIER = 1.05
"""Focal lengths of the calibration before the one in force, by the true ones."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    options = SceneOptions(n_cameras=4, n_people=3, n_frames=300, seed=1)
    return simulate(options, clips=shipped_clips())


def estimated(truth: Calibration, times: float = 1.0) -> Calibration:
    """A calibration that says its lenses were found, with other focal lengths."""
    scale = np.array([[times], [times], [1.0]])
    cameras = tuple(
        replace(
            camera,
            lens_knowledge=LensKnowledge.UNKNOWN,
            intrinsics=replace(camera.intrinsics, K=camera.intrinsics.K * scale),
        )
        for camera in truth.cameras
    )
    return replace(truth, cameras=cameras)


class Driver:
    """The driver of a camera, which keeps what it is given."""

    def __init__(self, client: Client, camera: str) -> None:
        self.given: list[Any] = []
        client.node.create_service(SetCameraInfo, f"/{camera}/set_camera_info", self._set)

    def _set(self, request: Any, response: Any) -> Any:
        self.given.append(request.camera_info)
        response.success = True
        return response


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, scene: Scene) -> Path:
    """Results folder with two calibrations."""
    made = tmp_path_factory.mktemp("lenses")
    history = History(made / "results", keep=10)
    for times in (EARLIER, 1.0):
        history.add(estimated(scene.truth, times))
    return made


@pytest.fixture(scope="module")
def client(folder: Path, scene: Scene) -> Iterator[Client]:
    """Client of a node of cameras without a lens, which has those of an earlier calibration."""
    bag = folder / "zeros.mcap"
    cameras = tuple(
        replace(c, intrinsics=unknown_intrinsics(c.intrinsics.width, c.intrinsics.height))
        for c in scene.recording.cameras
    )
    write_bag(replace(scene.recording, cameras=cameras), bag)
    given = {
        "cameras": f"[{', '.join(CAMERAS)}]",
        "queue_depth": "1000",
        "auto_calibrate": "false",
        "results_folder": str(folder / "results"),
        "camera.cam0.set_camera_info": "/cam0/set_camera_info",
        "camera.cam3.set_camera_info": "/cam3/set_camera_info",
    }
    live = LiveNode(folder, given, "lensless")
    client = Client("lensless")
    try:
        client.play_completely(bag, {c.name: len(c.stamps) for c in cameras})
        yield client
        assert live.stop()[0] == 0
        log = live.log.read_text()
        assert "Traceback" not in log
        assert log.count("sends on /cam0/camera_info: the lens is unknown") == 1
    finally:
        live.kill()
        client.close()


@pytest.fixture(scope="module")
def driver(client: Client) -> Driver:
    return Driver(client, "cam0")


def test_lenses_that_were_found_are_there_for_who_comes_late(client, scene, folder):
    for camera in scene.truth.cameras:
        (info,) = client.latched(CameraInfo, f"{camera.name}/camera_info", 1)
        np.testing.assert_allclose(np.reshape(info.k, (3, 3)), camera.intrinsics.K)
        assert info.header.frame_id == camera.frame_id
    (result,) = client.latched(CalibrationResult, "result", 1)
    assert [lens.camera for lens in result.intrinsics] == CAMERAS
    assert {lens.knowledge for lens in result.intrinsics} == {"unknown"}
    said = client.answer(SaveCalibration, "save", path="lenses", format="camera_info")
    assert said.success, said.message
    name, lens = read_camera_info_yaml(folder / "results" / "lenses" / "cam2.yaml")
    assert name == "cam2"
    np.testing.assert_allclose(lens.K, scene.truth.cameras[2].intrinsics.K)


def test_the_watch_sees_through_them(client):
    def verdicts() -> set[str]:
        client.next_diagnostics()
        return {client.status(f"camera {name}")["watch"] for name in CAMERAS}

    client.wait(lambda: verdicts() == {"ok"}, "the watch")


def test_where_lenses_are_to_be_given_zeros_are_named_with_what_to_do(client):
    for name in CAMERAS:
        status = client.status(f"camera {name}")
        assert f"sends on /{name}/camera_info: the lens is unknown" in status["message"]
        assert "set intrinsics to unknown" in status["message"]
        assert status["dropped"] == "0"
    refused = client.answer(Trigger, "recalibrate_now")
    assert (refused.success, "ready: none" in refused.message) == (False, True)


def test_a_rollback_hands_the_earlier_lens_to_its_driver(client, driver, scene):
    said = client.answer(Trigger, "rollback")
    assert said.success, said.message
    client.wait(lambda: bool(driver.given), "the lens")
    (info,) = driver.given
    true = scene.truth.cameras[0].intrinsics
    assert info.k[0] == pytest.approx(EARLIER * true.K[0, 0])
    assert (info.width, info.height) == (true.width, true.height)
    client.wait(
        lambda: client.status("camera cam0").get("set_camera_info") == "set", "the driver's answer"
    )
    client.wait(
        lambda: "no such service" in client.status("camera cam3")["set_camera_info"], "no driver"
    )
    (info,) = client.latched(CameraInfo, "cam0/camera_info", 1)
    assert info.k[0] == pytest.approx(EARLIER * true.K[0, 0])


def test_lenses_are_found_once_the_option_says_so(client, driver, scene):
    assert client.change(intrinsics="unknown") == [(True, "")]
    client.wait(lambda: "no lens" not in client.status("camera cam0")["message"], "another status")
    before = len(driver.given)
    answer = client.answer(Recalibrate, "recalibrate", wait=True)
    assert answer.result.status == CalibrationResult.OK, answer.result.message
    for lens, camera in zip(answer.result.intrinsics, scene.truth.cameras, strict=True):
        assert (lens.camera, lens.knowledge) == (camera.name, "unknown")
        assert lens.camera_info.k[0] == pytest.approx(camera.intrinsics.K[0, 0], rel=0.02)
        assert lens.focal_stddev_px > 0.0
        (info,) = client.latched(CameraInfo, f"{camera.name}/camera_info", 1)
        assert info.k == pytest.approx(lens.camera_info.k)
    client.wait(lambda: len(driver.given) > before, "the lens")
    assert driver.given[-1].k == pytest.approx(answer.result.intrinsics[0].camera_info.k)
