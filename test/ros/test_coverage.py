"""What a window has seen of an image, and what is still missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plain import info, poses

from stcalib_ros.io.assemble import CameraImages
from stcalib_ros.io.messages import camera_info_fields, pose_image
from stcalib_ros.ros.coverage import Coverage, ImageGrid, cells_seen, image_size

SIZE = (640, 480)


def image(stamp_s: float, *points: tuple[float, float], score: float = 1.0):
    """An image with one person whose keypoints are these points, in turn."""
    keypoints = np.resize(np.array(points, float), (17, 2))
    made = pose_image(poses(stamp_s, keypoints=keypoints.ravel()), topic="/poses")
    return replace(made, joint_scores=np.full((1, 17), score, np.float32))


def window(name: str, images, **changes: object) -> CameraImages:
    return CameraImages(name, images, camera_info_fields(info(**changes)), "/poses", "/info")


def test_a_cell_is_seen_if_a_keypoint_lies_in_it():
    images = [image(1.0, (1.0, 1.0), (639.0, 479.0)), image(1.1, (81.0, 1.0))]
    seen = cells_seen(images, SIZE, min_score=0.3)
    assert seen.shape == (6, 8)
    assert {tuple(cell) for cell in np.argwhere(seen)} == {(0, 0), (5, 7), (0, 1)}


@pytest.mark.parametrize("point", [(640.0, 10.0), (-1.0, 10.0), (10.0, 480.0), (np.nan, np.nan)])
def test_keypoints_outside_of_the_image_or_unknown_are_in_no_cell(point):
    assert not cells_seen([image(1.0, point)], SIZE, min_score=0.3).any()


def test_keypoints_of_a_low_score_and_images_of_unknown_size_do_not_count():
    assert not cells_seen([image(1.0, (1.0, 1.0), score=0.2)], SIZE, min_score=0.3).any()
    assert not cells_seen([image(1.0, (1.0, 1.0))], (0, 0), min_score=0.3).any()


def test_cells_leave_with_the_seconds_of_the_window_and_come_image_by_image():
    grid = ImageGrid()
    first, second, third = (
        image(10.2, (1.0, 1.0)),
        image(11.2, (81.0, 1.0)),
        image(11.3, (1.0, 479.0)),
    )
    assert grid.update([first, second], SIZE, min_score=0.3).sum() == 2
    assert grid.update([first, second, third], SIZE, min_score=0.3).sum() == 3
    left = grid.update([second, third], SIZE, min_score=0.3)
    assert {tuple(cell) for cell in np.argwhere(left)} == {(0, 1), (5, 0)}


def test_cells_begin_again_with_time_and_with_another_size():
    grid = ImageGrid()
    grid.update([image(50.0, (1.0, 1.0))], SIZE, min_score=0.3)
    again = grid.update([image(10.0, (639.0, 1.0))], SIZE, min_score=0.3)
    assert {tuple(cell) for cell in np.argwhere(again)} == {(0, 7)}
    larger = grid.update([image(10.0, (639.0, 1.0))], (1280, 960), min_score=0.3)
    assert {tuple(cell) for cell in np.argwhere(larger)} == {(0, 3)}


def test_the_size_is_that_of_the_image_not_of_the_sensor():
    images = [image(1.0, (1.0, 1.0))]
    assert image_size(window("cam0", images)) == SIZE
    assert image_size(window("cam0", images, binning_x=2, binning_y=2)) == (320, 240)


def look(moving: dict[str, set[int]], **given: float):
    windows = [window(name, [image(1.0, (1.0, 1.0))]) for name in ("cam0", "cam1", "cam2")]
    limits = {"wanted_s": 10.0, "slack_s": 0.0} | given
    return Coverage(("cam0", "cam1", "cam2", "cam3")).look(windows, moving, min_score=0.3, **limits)


def test_what_is_missing_is_said_of_every_camera():
    found = look({"cam0": set(range(12)), "cam1": set(range(2, 14)), "cam2": set(), "cam3": set()})
    assert found["cam0"].shared_s == {"cam1": 10, "cam2": 0, "cam3": 0}
    assert found["cam0"].best == ("cam1", 10)
    assert [found[name].missing for name in found] == [
        "",
        "",
        "people who move",
        "poses, or a lens",
    ]
    assert found["cam0"].share == pytest.approx(1 / 48)
    few = look({"cam0": set(range(4)), "cam1": set(range(3, 14))})
    assert few["cam0"].missing == "9 s more of people whom another camera sees, too"
    assert few["cam2"].missing == "poses, or a lens"


def test_seconds_are_shared_up_to_the_difference_of_clocks():
    moving = {"cam0": {0, 1, 2}, "cam1": {3, 4, 5}}
    assert look(moving)["cam0"].best[1] == 0
    assert look(moving, slack_s=3.0)["cam0"].best == ("cam1", 3)
