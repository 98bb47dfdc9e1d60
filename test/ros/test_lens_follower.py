"""Cameras whose lens is not known, or roughly, in the buffers of the live node; without ROS."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plain import CAMERA, Ear, fill, info

from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.rejection import RejectionReason
from stcalib_ros.io.assemble import assemble_recording
from stcalib_ros.io.lens_settings import LensSettings
from stcalib_ros.io.messages import camera_info_fields, lens
from stcalib_ros.ros.buffers import Buffers
from stcalib_ros.ros.lens_input import DriverImage
from stcalib_ros.ros.limits import LENS_QUIET_S
from stcalib_ros.ros.streams import Limits

NO_LENS = {"k": [0.0] * 9, "d": [], "distortion_model": ""}
K = [800.0, 0.0, 330.0, 0.0, 800.0, 250.0, 0.0, 0.0, 1.0]


class Camera:
    """One camera of the live node, and a clock."""

    def __init__(self, default: str = "given", **settings: object) -> None:
        self.now_s, self.ear = 0.0, Ear()
        camera = replace(CAMERA, lens=LensSettings(**settings))  # type: ignore[arg-type]
        self.buffers = Buffers([camera], Limits(), self.ear, clock=lambda: self.now_s)
        self.buffers.set_default(LensKnowledge(default))

    def info(self, **fields: object) -> None:
        self.buffers.add_info("cam0", info(**fields))

    def walks(self) -> None:
        fill(self.buffers, 100.0, 4.0, speed_px_s=60.0)

    @property
    def counts(self):
        return self.buffers.counts()["cam0"]

    @property
    def is_ready(self) -> bool:
        return bool(self.buffers.moving().get("cam0"))

    @property
    def recorded(self):
        recording = assemble_recording(self.buffers.snapshot(), warn=lambda _: None)
        return recording.cameras[0]


def test_zeros_are_no_lens_where_one_is_to_be_given_and_are_waited_with():
    camera = Camera()
    camera.info(**NO_LENS)
    camera.walks()
    assert camera.counts.no_lens.reason is RejectionReason.LENS_UNKNOWN
    assert (camera.counts.dropped, camera.is_ready) == (0, False)
    assert not camera.recorded.intrinsics.known, "the result will say why it is not in it"
    camera.info(k=K)
    assert (camera.counts.no_lens, camera.counts.images, camera.is_ready) == (None, 40, True)
    assert camera.recorded.intrinsics.K[0, 0] == 800.0
    camera.info(**NO_LENS)
    assert camera.counts.dropped == 1, "nobody takes a lens away"
    assert "set intrinsics to unknown" in camera.ear.lines[-1]


@pytest.mark.parametrize("fields", [NO_LENS, {"k": K}, {"k": K, "distortion_model": "mine"}])
def test_of_an_unknown_lens_the_size_of_the_image_is_enough(fields):
    camera = Camera(knowledge=LensKnowledge.UNKNOWN, group="one model")
    camera.info(**fields)
    camera.walks()
    assert (camera.counts.no_lens, camera.is_ready) == (None, True)
    found = camera.recorded
    assert (found.lens_knowledge, found.lens_group) == (LensKnowledge.UNKNOWN, "one model")
    assert (found.intrinsics.width, found.intrinsics.height) == (640, 480)
    assert not found.intrinsics.known


def test_the_default_is_that_of_the_parameters_and_may_change():
    camera = Camera("unknown")
    camera.info(**NO_LENS)
    camera.walks()
    assert camera.is_ready
    assert camera.recorded.lens_knowledge is None, "as the options have it"
    camera.buffers.set_default(LensKnowledge.GIVEN)
    assert not camera.is_ready


def test_without_camera_info_the_size_is_enough_and_no_other_may_come():
    camera = Camera(knowledge=LensKnowledge.UNKNOWN, image_size=(640, 480))
    camera.walks()
    assert (camera.counts.has_info, camera.is_ready) == (True, True)
    assert camera.recorded.intrinsics.width == 640
    camera.info(width=1280)
    assert camera.counts.dropped == 1
    assert "is given as 640 x 480 px, but CameraInfo says 1280 x 480" in camera.ear.lines[-1]
    camera.info(width=0, height=0, **NO_LENS)
    camera.info(k=K)
    assert (camera.counts.dropped, camera.counts.images) == (1, 40)


def test_a_view_of_a_data_sheet_is_where_refining_starts():
    camera = Camera(field_of_view_deg=90.0)
    camera.info(**NO_LENS)
    camera.walks()
    assert camera.is_ready
    assert camera.recorded.lens_knowledge is LensKnowledge.REFINE
    assert camera.recorded.intrinsics.K[0, 0] == pytest.approx(320.0)


@pytest.mark.parametrize(("worth", "n_images"), [("unknown", 40), ("refine", 40), ("given", 0)])
def test_a_driver_that_takes_a_lens_over_changes_nothing_where_it_is_estimated(worth, n_images):
    camera = Camera(knowledge=LensKnowledge(worth))
    camera.info()
    camera.walks()
    for _ in range(3):
        camera.info(k=K)
        camera.now_s += LENS_QUIET_S
    assert camera.counts.images == n_images
    assert camera.counts.flushes == (not n_images)
    camera.walks()
    assert camera.recorded.intrinsics.known == (worth != "unknown")
    if worth != "unknown":
        assert camera.recorded.intrinsics.K[0, 0] == 800.0


@pytest.mark.parametrize("worth", LensKnowledge)
def test_another_size_of_the_image_is_another_camera(worth):
    camera = Camera(knowledge=worth)
    camera.info()
    camera.walks()
    camera.info(width=1280, height=960)
    assert camera.counts.images == 40
    camera.now_s += LENS_QUIET_S
    assert (camera.counts.images, camera.counts.flushes) == (0, 1)


def image(*, rectified: bool = False, **fields: object) -> DriverImage:
    return DriverImage(camera_info_fields(info(**fields)), rectified)


FOUND = camera_info_fields(info(width=400, height=150, k=K, p=[*K[:3], 0, *K[3:6], 0, *K[6:], 0]))


def test_a_driver_gets_the_lens_of_its_sensor():
    roi = type("", (), {"x_offset": 40, "y_offset": 20, "width": 800, "height": 600})()
    cut = image(width=1280, height=720, binning_x=2, binning_y=4, roi=roi)
    assert cut.mismatch(FOUND) == ""
    whole = cut.of_sensor(FOUND)
    assert (whole.width, whole.height, whole.binning_x, whole.roi) == (1280, 720, 0, (0, 0, 0, 0))
    again = whole._replace(binning_x=2, binning_y=4, roi=(40, 20, 800, 600), r=np.eye(3).ravel())
    for rectified in (False, True):
        seen = lens(again._replace(r=tuple(again.r)), rectified=rectified, topic="")
        np.testing.assert_allclose(seen.K.ravel(), K)
        assert (seen.width, seen.height) == (400, 150)


def test_a_driver_gets_no_lens_of_another_image():
    assert DriverImage(None, rectified=False).mismatch(FOUND) == ""
    assert DriverImage(None, rectified=False).of_sensor(FOUND) is FOUND
    assert "640 x 480 px now, and had 400 x 150 px when" in image().mismatch(FOUND)
    assert "rectified" in image(width=400, height=150, rectified=True).mismatch(FOUND)


def test_what_was_waited_with_is_the_same_lens_after_the_parameters_have_changed():
    camera = Camera()
    camera.info()
    camera.info(k=K)
    assert "waiting to see" in camera.ear.lines[-1]
    camera.buffers.set_default(LensKnowledge.UNKNOWN)
    camera.info(k=K)
    camera.now_s += LENS_QUIET_S
    assert (camera.counts.dropped, camera.counts.no_lens) == (0, None)
