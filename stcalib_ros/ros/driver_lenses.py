"""Hands lenses that were estimated to the drivers of the cameras, where that is asked for."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from rclpy.exceptions import InvalidServiceNameException
from sensor_msgs.srv import SetCameraInfo

from stcalib_ros.core.errors import InputError, one_line
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.io.messages import camera_info_fields
from stcalib_ros.msg import CameraIntrinsics
from stcalib_ros.ros.convert import camera_info_message
from stcalib_ros.ros.lens_input import DriverImage
from stcalib_ros.ros.limits import DRIVER_S, MAX_LINE


class DriverState(NamedTuple):
    """Whether a driver has the lens in force, in words; failed: it was to have it and has not."""

    text: str
    failed: bool = False


OFF = DriverState("off")
"""Of a driver that is not to be called."""
_NOTHING = DriverState("nothing to set yet")


@dataclass(slots=True)
class _Driver:
    """Service of one driver.

    Attributes
    ----------
    service : str
    client : rclpy.client.Client
    asked : Future or None
        Gives the driver's answer.
    asked_s : float
        When it was asked, steady.
    state : DriverState
    """

    service: str
    client: Any
    asked: Any = None
    asked_s: float = 0.0
    state: DriverState = _NOTHING


class DriverLenses:
    """Calls ``set_camera_info`` once for each lens; what comes of it changes nothing else.

    Parameters
    ----------
    node : rclpy.node.Node
    services : mapping of str to str
        Name of the service by camera; empty: this driver is not called.
    clock : callable
        Steady, seconds.

    Raises
    ------
    InputError
        A name can be none of a service.
    """

    def __init__(
        self,
        node: Any,
        services: Mapping[str, str],
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._log, self._clock = node.get_logger(), clock
        self._drivers = {
            camera: _Driver(service, _client(node, camera, service))
            for camera, service in services.items()
            if service
        }

    def states(self) -> dict[str, DriverState]:
        """What came of it, by camera."""
        self._give_up()
        return {camera: driver.state for camera, driver in self._drivers.items()}

    def offer(self, lenses: Iterable[CameraIntrinsics], images: Mapping[str, DriverImage]) -> None:
        """Hand over the lenses of a calibration that has come into force.

        Parameters
        ----------
        lenses : iterable of CameraIntrinsics
            Those that were given are passed over: the driver has them.
        images : mapping of str to DriverImage
            Which image the keypoints of each camera are in.
        """
        for lens in lenses:
            driver = self._drivers.get(lens.camera)
            if driver is not None and lens.knowledge != LensKnowledge.GIVEN.value:
                self._ask(driver, lens, images[lens.camera])

    def _ask(self, driver: _Driver, lens: CameraIntrinsics, image: DriverImage) -> None:
        driver.asked = None
        fields = camera_info_fields(lens.camera_info)
        problem = image.mismatch(fields)
        if not problem and not driver.client.service_is_ready():
            problem = "there is no such service"
        if problem:
            self._fail(driver, problem)
            return
        info = camera_info_message(image.of_sensor(fields), lens.camera_info.header)
        driver.state, driver.asked_s = DriverState("asked"), self._clock()
        driver.asked = driver.client.call_async(SetCameraInfo.Request(camera_info=info))
        driver.asked.add_done_callback(partial(self._answered, driver))

    def _answered(self, driver: _Driver, asked: Any) -> None:
        if asked is not driver.asked:
            return  # of a lens that another one has replaced, or too late
        driver.asked = None
        if (error := asked.exception()) is not None:
            self._fail(driver, str(error))
        elif not asked.result().success:
            self._fail(driver, f"the driver refused: {asked.result().status_message}")
        else:
            driver.state = DriverState("set")
            self._log.info(f"{driver.service}: the driver has the lens now")

    def _give_up(self) -> None:
        """Note drivers that have not answered within `DRIVER_S`."""
        for driver in self._drivers.values():
            if driver.asked is not None and self._clock() - driver.asked_s > DRIVER_S:
                driver.client.remove_pending_request(driver.asked)
                driver.asked = None
                self._fail(driver, f"no answer within {DRIVER_S:g} s")

    def _fail(self, driver: _Driver, why: str) -> None:
        driver.state = DriverState(one_line(f"{driver.service}: {why}", MAX_LINE), failed=True)
        self._log.warning(f"{driver.state.text}; the lens is published and saved all the same")


def _client(node: Any, camera: str, service: str) -> Any:
    try:
        return node.create_client(SetCameraInfo, service)
    except InvalidServiceNameException as error:
        raise InputError(
            one_line(f"camera.{camera}.set_camera_info: {service!r}: {error}", MAX_LINE)
        ) from error
