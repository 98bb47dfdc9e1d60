"""The room stands upright, on its floor, and is seen from a side that shows it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from stcalib_ros.core.stages import Stages
from stcalib_ros.core.synthetic import Scene
from stcalib_ros.report.content import ReportContent
from stcalib_ros.report.curves import liveliest_movement
from stcalib_ros.report.room import Room, make_room
from stcalib_ros.report.view import best_view, frustum_depth


@pytest.fixture(scope="module")
def room(report_scene: Scene, report_stages: Stages) -> Room:
    return make_room(report_stages.calibration, report_stages.trajectories(), report_scene.truth)


def test_up_is_up_and_the_floor_is_below(report_scene: Scene, room: Room) -> None:
    true_up = report_scene.rig.R_cam_world[0][:, 2]
    assert np.degrees(np.arccos(room.R_room_ref[2] @ true_up)) < 8.0
    assert np.linalg.det(room.R_room_ref) == pytest.approx(1.0)
    heights = [camera.centre[2] for camera in room.cameras]
    assert heights == pytest.approx(report_scene.rig.centres_world[:, 2], abs=0.6)
    for person in room.people:
        lowest = np.nanpercentile(person.joints[..., 2], 2)
        assert lowest == pytest.approx(0.0, abs=0.3)


def test_true_cameras_stand_beside_those_found(room: Room) -> None:
    assert [c.name for c in room.true_cameras] == ["cam0", "cam1", "cam2"]
    for found, true in zip(room.cameras, room.true_cameras, strict=True):
        assert found.centre == pytest.approx(true.centre, abs=0.05)
        assert found.R_room_cam == pytest.approx(true.R_room_cam, abs=0.02)


def test_two_cameras_cannot_be_aligned(report_scene: Scene, report_stages: Stages) -> None:
    truth = dataclasses.replace(report_scene.truth, cameras=report_scene.truth.cameras[:2])
    assert make_room(report_stages.calibration, (), truth).true_cameras == ()


def test_without_people_the_cameras_tell_what_is_up(
    report_scene: Scene, report_stages: Stages
) -> None:
    room = make_room(report_stages.calibration, ())
    assert room.R_room_ref[2] @ report_scene.rig.R_cam_world[0][:, 2] > 0.8
    assert min(camera.centre[2] for camera in room.cameras) == pytest.approx(0.0)


def test_a_frustum_is_what_the_image_shows(report_scene: Scene, room: Room) -> None:
    camera, lens = room.cameras[0], report_scene.truth.cameras[0].intrinsics
    corners = (camera.frustum(2.0) - camera.centre) @ camera.R_room_cam
    pixels = corners @ lens.K.T
    pixels = pixels[:, :2] / pixels[:, 2:]
    assert corners[:, 2] == pytest.approx(2.0)
    assert np.ptp(pixels, axis=0) == pytest.approx([lens.width, lens.height])


def test_the_view_keeps_cameras_apart_and_upright(room: Room) -> None:
    view = best_view(room)
    page = view.project(np.array([camera.centre for camera in room.cameras]))
    apart = np.linalg.norm(page[:, None] - page[None], axis=-1)[np.triu_indices(3, 1)]
    assert apart.min() > 2.0 * frustum_depth(room)
    (foot, head) = view.project(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.7]]))
    assert head[1] > foot[1]
    assert abs(head[0] - foot[0]) < 0.3 * (head[1] - foot[1])
    assert np.allclose(view.R @ view.R.T, np.eye(3))


def test_nearer_things_are_larger(room: Room) -> None:
    view = best_view(room)
    near, far = (view.middle + s * view.R[2] for s in (1.0, -1.0))
    step = 0.1 * view.R[0]
    sizes = [np.linalg.norm(view.project(p + step) - view.project(p)) for p in (near, far)]
    assert sizes[0] > sizes[1]
    assert view.nearness(near) > view.nearness(far)


def test_curves_lie_on_one_another_by_the_common_clock(
    report_content: ReportContent, room: Room
) -> None:
    movement = liveliest_movement(report_content, room)
    assert movement is not None
    assert movement.reference == "cam0"
    assert len(movement.curves) == 3
    grid = np.linspace(*np.nanpercentile(movement.curves[0].times_s, [10, 90]), 40)

    def spread(clock: str) -> float:
        heights = []
        for curve in movement.curves:
            known = np.isfinite(curve.height)
            heights.append(np.interp(grid, getattr(curve, clock)[known], curve.height[known]))
        return float(np.median(np.ptp(heights, axis=0)))

    assert spread("times_s") < 0.02
    assert spread("stamps_s") > 3.0 * spread("times_s")


def test_curves_show_the_true_height(
    report_content: ReportContent, report_scene: Scene, report_stages: Stages, room: Room
) -> None:
    movement = liveliest_movement(report_content, room)
    assert movement is not None
    person = report_stages.calibration.persons[movement.person_id]
    (true_person,) = (
        p.person_id
        for p in report_scene.truth.persons
        if person.tracks["cam0"][0] in p.tracks["cam0"]
        and person.tracks["cam1"][0] in p.tracks["cam1"]
    )
    joint = report_stages.skeleton.layout.joint_names.index(movement.joint)
    for curve in movement.curves:
        known = np.isfinite(curve.height)
        path = report_scene.joints_ref(curve.times_s[known])[true_person, :, joint]
        height = (path @ room.R_room_ref.T + room.t_room_ref)[:, 2]
        assert np.median(np.abs(height - curve.height[known])) < 0.15
        assert np.corrcoef(height, curve.height[known])[0, 1] > 0.99
        assert np.ptp(curve.times_s[known]) <= 3.2
