"""Drivers get the lenses that were estimated, once, and what they say of it changes nothing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from live import Client
from samples import LENS, STAMP, calibration
from sensor_msgs.srv import SetCameraInfo

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.ros.convert import intrinsics_messages
from stcalib_ros.ros.driver_lenses import DriverLenses
from stcalib_ros.ros.lens_input import DriverImage
from stcalib_ros.ros.limits import DRIVER_S

CALIBRATION = calibration()
FOUND = intrinsics_messages(
    replace(
        CALIBRATION,
        cameras=tuple(
            replace(camera, lens_knowledge=knowledge)
            for camera, knowledge in zip(CALIBRATION.cameras, LensKnowledge, strict=True)
        ),
    ),
    stamp=STAMP,
)
SERVICES = {camera.name: f"/{camera.name}/set_camera_info" for camera in CALIBRATION.cameras}
IMAGES = {camera.name: DriverImage(None, rectified=False) for camera in CALIBRATION.cameras}


class Driver:
    """A driver that notes what it is given."""

    def __init__(self, client: Client, camera: str, *, refuses: str = "") -> None:
        self.given: list[Any] = []
        self._refuses = refuses
        client.node.create_service(SetCameraInfo, SERVICES[camera], self._set)

    def _set(self, request: Any, response: Any) -> Any:
        self.given.append(request.camera_info)
        response.success, response.status_message = not self._refuses, self._refuses
        return response


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def client() -> Iterator[Client]:
    """A node that has the drivers and asks itself."""
    made = Client("drivers")
    yield made
    made.close()


def ready(client: Client, lenses: DriverLenses, *cameras: str) -> None:
    asked = [client.node.create_client(SetCameraInfo, SERVICES[c]) for c in cameras]
    client.wait(lambda: all(one.service_is_ready() for one in asked), "the services")
    assert {state.text for state in lenses.states().values()} == {"nothing to set yet"}


def test_drivers_get_what_was_estimated_once(client):
    given, refined, unknown = (Driver(client, camera) for camera in SERVICES)
    lenses = DriverLenses(client.node, SERVICES)
    ready(client, lenses, *SERVICES)
    lenses.offer(FOUND, IMAGES)
    client.wait(lambda: bool(refined.given) and bool(unknown.given), "the lenses")
    client.wait(lambda: lenses.states()["cam2"].text == "set", "the answer")
    client.wait(lambda: lenses.states()["cam1"].text == "set", "the answer")
    assert [len(driver.given) for driver in (given, refined, unknown)] == [0, 1, 1]
    assert not any(state.failed for state in lenses.states().values())
    (info,) = unknown.given
    assert (info.width, info.height, info.header.frame_id) == (640, 480, "cam2_optical_frame")
    np.testing.assert_array_equal(np.reshape(info.k, (3, 3)), LENS.K)


def test_a_driver_that_refuses_is_said_and_asked_again_for_the_next(client):
    driver = Driver(client, "cam2", refuses="read-only\ncalibration")
    lenses = DriverLenses(client.node, {"cam2": SERVICES["cam2"]})
    ready(client, lenses, "cam2")
    for n in (1, 2):
        lenses.offer(FOUND, IMAGES)
        client.wait(lambda n=n: len(driver.given) == n, "the lens")
        client.wait(lambda: lenses.states()["cam2"].failed, "the refusal")
        text = lenses.states()["cam2"].text
        assert text.startswith("/cam2/set_camera_info: the driver refused: read-only")
        assert "\n" not in text


def test_a_driver_that_is_not_there_or_does_not_answer_is_said(client):
    clock = Clock()
    lenses = DriverLenses(client.node, SERVICES, clock=clock)
    lenses.offer(FOUND, IMAGES)
    states = lenses.states()
    assert states["cam0"] == ("nothing to set yet", False), "its lens was given"
    assert states["cam1"] == ("/cam1/set_camera_info: there is no such service", True)
    driver = Driver(client, "cam2")
    again = client.node.create_client(SetCameraInfo, SERVICES["cam2"])
    client.wait(again.service_is_ready, "the service")
    lenses.offer(FOUND[2:], IMAGES)
    assert lenses.states()["cam2"].text == "asked"
    clock.now_s += DRIVER_S + 1.0
    assert lenses.states()["cam2"] == (
        f"/cam2/set_camera_info: no answer within {DRIVER_S:g} s",
        True,
    )
    client.wait(lambda: bool(driver.given), "what comes too late")
    assert lenses.states()["cam2"].failed


def test_no_driver_is_called_for_another_image(client):
    driver = Driver(client, "cam2")
    lenses = DriverLenses(client.node, {"cam0": "", "cam2": SERVICES["cam2"]})
    ready(client, lenses, "cam2")
    lenses.offer(FOUND, IMAGES | {"cam2": DriverImage(None, rectified=True)})
    assert "not called" in lenses.states()["cam2"].text
    assert (set(lenses.states()), driver.given) == ({"cam2"}, [])


def test_a_name_that_is_none_of_a_service_is_said(client):
    with pytest.raises(InputError, match=r"camera\.cam0\.set_camera_info: 'a b'"):
        DriverLenses(client.node, {"cam0": "a b"})
