"""People in images: where they are projected, against where a simulated camera saw them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import stcalib_ros as st
from stcalib_ros.core.capture.reprojection import (
    ImageOfPeople,
    PeopleInImages,
    joints_in_image,
    people_in_images,
)
from stcalib_ros.core.reconstruction.trajectories import PersonTrajectory

SCENE = st.SceneOptions(n_cameras=3, n_people=2, n_frames=60, sigma_px=0.5)


@pytest.fixture(scope="module")
def seen() -> PeopleInImages:
    scene = st.simulate(SCENE)
    people = st.capture_people(scene.recording, scene.truth).people
    return people_in_images(scene.recording, scene.truth, people, min_score=0.3)


def test_people_are_projected_onto_their_keypoints(seen: PeopleInImages) -> None:
    images = seen.at(seen.best_time_s())
    assert len(images) == 3
    for image in images:
        assert image.n_compared > 20
        assert image.residual_px < 3.0


def test_images_are_those_of_one_time_whatever_their_clocks_say(seen: PeopleInImages) -> None:
    time_s = float(seen.times_s()[30])
    offsets = {camera.name: camera.time_offset_s for camera in seen.calibration.cameras}
    assert max(map(abs, offsets.values())) > 0.1
    assert [image.time_s for image in seen.at(time_s)] == pytest.approx([time_s] * 3, abs=0.02)


def test_a_camera_that_recorded_nothing_then_is_left_out(seen: PeopleInImages) -> None:
    assert seen.at(float(seen.times_s()[-1]) + 100.0) == ()


def test_a_wrong_clock_shows(seen: PeopleInImages) -> None:
    def late(camera: st.CameraCalibration) -> st.CameraCalibration:
        return replace(camera, time_offset_s=camera.time_offset_s + 0.2)

    cameras = tuple(c if c.name == "cam0" else late(c) for c in seen.calibration.cameras)
    wrong = replace(seen, calibration=replace(seen.calibration, cameras=cameras))

    def residual(images: tuple[ImageOfPeople, ...]) -> float:
        return max(image.residual_px for image in images if image.n_compared)

    time_s = float(seen.times_s()[30])
    assert residual(wrong.at(time_s)) > 5 * residual(seen.at(time_s))


def falling(camera: st.CameraCalibration) -> PersonTrajectory:
    """A joint that moves along the rows of a camera's image, 2 m in front of it."""
    times_s = np.linspace(0.0, 1.0, 11)
    joints_cam = np.zeros((11, 1, 3))
    joints_cam[:, 0] = np.stack([np.zeros(11), 0.4 * times_s, np.full(11, 2.0)], -1)
    joints_ref = joints_cam @ camera.R_ref_cam.T + camera.t_ref_cam
    layout = st.Layout("point", ("nose",), (-1,))
    return PersonTrajectory(0, layout, times_s, joints_ref, np.zeros((11, 1)))


def test_with_a_rolling_shutter_a_joint_is_where_it_was_when_its_row_was_exposed(
    seen: PeopleInImages,
) -> None:
    line_time_s = 50e-6
    camera = replace(seen.calibration.cameras[1], line_time_s=line_time_s)
    person = falling(camera)
    (found,) = joints_in_image(person, camera, 0.5)
    (alike,) = joints_in_image(
        person, replace(camera, line_time_s=0.0), 0.5 + line_time_s * float(found[1])
    )
    assert found == pytest.approx(alike, abs=0.1)
    (unmoved,) = joints_in_image(person, replace(camera, line_time_s=0.0), 0.5)
    assert found[1] - unmoved[1] > 1.0


def test_who_is_out_of_view_is_not_there(seen: PeopleInImages) -> None:
    camera = seen.calibration.cameras[1]
    person = falling(camera)
    behind = replace(person, joints_ref=2 * camera.t_ref_cam - person.joints_ref)
    assert np.isnan(joints_in_image(behind, camera, 0.5)).all()
    assert np.isnan(joints_in_image(person, camera, 5.0)).all()
