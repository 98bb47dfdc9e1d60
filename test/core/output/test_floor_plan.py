"""A calibration in the frame of a plan, by where some of its cameras are there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from export_helpers import in_world

import stcalib_ros as st
from stcalib_ros.core.bundle.covariance import PARAMETERS
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.output.floor_plan import placed_on_plan

TRUTH = st.simulate(st.SceneOptions(n_cameras=4, n_people=1, n_frames=2)).truth
UPRIGHT = in_world(TRUTH)
TURN = exp_so3(np.array([0.0, 0.0, 2.0]))
SHIFT = np.array([12.0, -7.0, 0.0])


def on_plan(result: st.Calibration, names: Sequence[str], n: int) -> dict[str, Float64Array]:
    """Places in a frame that is turned about the vertical and moved."""
    poses = {camera.name: camera.t_ref_cam for camera in result.cameras}
    return {name: (TURN @ poses[name] + SHIFT)[:n] for name in names}


def in_other_unit(result: st.Calibration, factor: float) -> st.Calibration:
    cameras = [replace(c, t_ref_cam=factor * c.t_ref_cam) for c in result.cameras]
    return replace(result, cameras=tuple(cameras), metric=False)


@pytest.mark.parametrize(("names", "n"), [(("cam1", "cam3"), 2), (("cam0", "cam1", "cam2"), 3)])
def test_all_cameras_come_to_their_places(names: Sequence[str], n: int) -> None:
    placed = placed_on_plan(UPRIGHT, on_plan(UPRIGHT, names, n), "hall")
    assert placed.calibration.frame_id == "hall"
    assert placed.scale == 1.0
    assert list(placed.misfits_m) == list(names)
    assert max(placed.misfits_m.values()) < 1e-9
    for before, after in zip(UPRIGHT.cameras, placed.calibration.cameras, strict=True):
        assert after.t_ref_cam == pytest.approx(TURN @ before.t_ref_cam + SHIFT, abs=1e-9)
        assert np.abs(after.R_ref_cam - TURN @ before.R_ref_cam).max() < 1e-9
        assert after.time_offset_s == before.time_offset_s


@pytest.mark.parametrize(("names", "n"), [(("cam0", "cam2"), 2), (("cam0", "cam1", "cam2"), 3)])
def test_a_result_without_a_unit_becomes_metric(names: Sequence[str], n: int) -> None:
    places = on_plan(UPRIGHT, names, n)
    placed = placed_on_plan(in_other_unit(UPRIGHT, 0.25), places, "hall")
    assert placed.calibration.metric
    assert placed.scale == pytest.approx(4.0)
    apart = np.array(list(places.values())) - np.mean(list(places.values()), axis=0)
    assert placed.calibration.scale_stddev == pytest.approx(0.05 / np.linalg.norm(apart))
    for before, after in zip(UPRIGHT.cameras, placed.calibration.cameras, strict=True):
        assert after.t_ref_cam == pytest.approx(TURN @ before.t_ref_cam + SHIFT, abs=1e-9)


def test_covariances_turn_and_grow_with_the_poses() -> None:
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(len(TRUTH.cameras), 6, 6))
    cameras = tuple(
        replace(c, covariance=root @ root.T) for c, root in zip(UPRIGHT.cameras, roots, strict=True)
    )
    n = len(PARAMETERS) * len(cameras)
    root = rng.normal(size=(n, n))
    result = replace(UPRIGHT, cameras=cameras, joint_covariance=root @ root.T)
    small = replace(in_other_unit(result, 0.25), joint_covariance=result.joint_covariance)
    found = placed_on_plan(small, on_plan(UPRIGHT, ["cam0", "cam2"], 2), "hall").calibration
    for before, after in zip(small.cameras, found.cameras, strict=True):
        position = 16.0 * TURN @ before.covariance[:3, :3] @ TURN.T
        assert after.covariance[:3, :3] == pytest.approx(position)
        assert after.covariance[3:, 3:] == pytest.approx(TURN @ before.covariance[3:, 3:] @ TURN.T)
    joint = found.joint_covariance
    assert joint[:3, :3] == pytest.approx(16.0 * TURN @ result.joint_covariance[:3, :3] @ TURN.T)
    assert joint[6, 13] == pytest.approx(result.joint_covariance[6, 13])


def test_places_say_more_of_the_unit_than_the_size_of_people() -> None:
    by_poses = replace(in_other_unit(UPRIGHT, 1.0 / 1.15), metric=True, scale_stddev=0.1)
    found = placed_on_plan(by_poses, on_plan(UPRIGHT, ["cam0", "cam2"], 2), "hall")
    assert found.scale == pytest.approx(1.15)
    assert found.calibration.scale_stddev < 0.1
    wrong = replace(by_poses, scale_stddev=0.025)
    with pytest.raises(InputError, match=r"1.15 times as far apart .* to 2 %|to 2%"):
        placed_on_plan(wrong, on_plan(UPRIGHT, ["cam0", "cam2"], 2), "hall")
    with pytest.raises(InputError, match="cannot be at these places"):
        placed_on_plan(
            replace(by_poses, scale_stddev=1e-4), on_plan(UPRIGHT, ["cam0", "cam2"], 2), "hall"
        )


def test_exchanged_cameras_and_mirrored_plans_are_refused() -> None:
    places = on_plan(UPRIGHT, ["cam0", "cam1", "cam2"], 2)
    mirrored = {name: place * [1.0, -1.0] for name, place in places.items()}
    exchanged = places | {"cam0": places["cam1"], "cam1": places["cam0"]}
    for wrong in (mirrored, exchanged):
        with pytest.raises(InputError, match=r"cannot be at these places: .*cam0 by \d+\.\d+ m"):
            placed_on_plan(UPRIGHT, wrong, "hall")


@pytest.mark.parametrize(
    ("result", "places", "problem"),
    [
        (UPRIGHT, {"cam0": (0, 0), "cam9": (1, 0)}, "there is no camera cam9; there are cam0, "),
        (UPRIGHT, {"cam0": (0, 0), "cam1": (1, 0, 0)}, "give x and y of all cameras, or"),
        (UPRIGHT, {"cam0": (0, 0)}, "2 cameras are needed, got 1"),
        (UPRIGHT, {"cam0": (0, 0, 1), "cam1": (1, 0, 1)}, "3 cameras are needed, got 2"),
        (UPRIGHT, {"cam0": (1, 2), "cam1": (1, 2)}, "these cameras are at one place"),
        (TRUTH, {"cam0": (0, 0), "cam1": (1, 0)}, "the result has no vertical: calibrate with"),
        (
            UPRIGHT,
            {"cam0": (0, 0, 0), "cam1": (1, 0, 0), "cam2": (2, 0, 0)},
            "the cameras are on a line",
        ),
    ],
)
def test_what_does_not_determine_the_frame_is_refused(
    result: st.Calibration, places: dict[str, tuple[float, ...]], problem: str
) -> None:
    given = {name: np.array(place, float) for name, place in places.items()}
    with pytest.raises(InputError, match=problem):
        placed_on_plan(result, given, "hall")


def test_the_frame_is_not_that_of_a_camera() -> None:
    frame = UPRIGHT.cameras[1].frame_id
    with pytest.raises(InputError, match=f"the frame {frame} is that of cam1"):
        placed_on_plan(UPRIGHT, on_plan(UPRIGHT, ["cam0", "cam1"], 2), frame)
