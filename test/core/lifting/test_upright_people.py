"""Focal length of one camera by the upright people before it."""

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import every

import stcalib_ros as st
from stcalib_ros.core.lifting.assumed_lenses import assumed_lens
from stcalib_ros.core.lifting.lift import lift_recording
from stcalib_ros.core.lifting.upright_people import focal_length_prior
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS, layout_from_names
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack
from stcalib_ros.core.model.recording import keypoints_only
from stcalib_ros.core.model.skeleton import Skeleton, body_bones, common_skeleton

LAYOUT = LAYOUTS["coco_17"]
HEIGHTS = {"ankle": 0.1, "knee": 0.5, "hip": 0.9, "shoulder": 1.45}
"""Metres above the floor, of somebody who stands straight."""
N = 400


def skeleton_of(layout):
    return Skeleton(layout, (np.arange(layout.n_joints),), *body_bones(layout))


def looking_down(tilt_deg, roll_deg=0.0):
    """R_cam_world of a camera that looks along y of a world with z up."""
    a, b = np.radians([tilt_deg, roll_deg])
    level = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    tilt = np.array([[1, 0, 0], [0, np.cos(a), np.sin(a)], [0, -np.sin(a), np.cos(a)]])
    roll = np.array([[np.cos(b), -np.sin(b), 0], [np.sin(b), np.cos(b), 0], [0, 0, 1]])
    return roll @ tilt.T @ level


def sticks(rng, R_cam_world, *, height=2.5, focal_ratio=1.0, lean=0.0, places=N, crouch=0.0):
    """A camera that sees three people without errors, each at many places on the floor.

    Its keypoints are on the plane z = 1 of a lens whose focal length is the true one over a ratio.
    """
    tracks = []
    for k, size in enumerate((0.95, 1.0, 1.08)):
        spot = rng.uniform([-1.8, 2.5], [1.8, 7.0], (places, 2))[np.arange(N) * places // N]
        towards = rng.normal(scale=lean, size=(places, 2))[np.arange(N) * places // N]
        x = np.full((N, LAYOUT.n_joints, 2), np.nan)
        for joint, z in HEIGHTS.items():
            for side, aside in (("left", -0.12), ("right", 0.12)):
                X = np.column_stack([spot, np.full(N, size * z)]) - [0, 0, height]
                X[:, 0] += aside + crouch * (joint == "knee")
                X[:, :2] += towards * size * z
                X_cam = X @ R_cam_world.T
                x[:, LAYOUT.index(f"{side}_{joint}")] = focal_ratio * X_cam[:, :2] / X_cam[:, 2:]
        nowhere = np.full((N, 3), np.nan)
        tracks.append(
            LiftedTrack(k, np.arange(N), x, np.full(x.shape[:2], 1400.0), nowhere[:, None], nowhere)
        )
    return LiftedCamera("cam", np.arange(N) / 10.0, tuple(tracks))


def prior(camera):
    return focal_length_prior(camera, skeleton_of(LAYOUT))


@pytest.mark.parametrize("ratio", [0.65, 1.0, 1.35])
@pytest.mark.parametrize(("tilt", "roll"), [(12.0, 0.0), (25.0, 5.0), (18.0, 90.0), (18.0, 180.0)])
def test_exact_people_give_the_focal_length(rng, ratio, tilt, roll):
    found = prior(sticks(rng, looking_down(tilt, roll), focal_ratio=ratio))
    assert found is not None
    assert found.log_ratio == pytest.approx(np.log(ratio), abs=0.02)


@pytest.mark.parametrize(("tilt", "height"), [(50.0, 4.0), (-12.0, 1.0), (-18.0, 0.3)])
def test_cameras_under_the_ceiling_and_near_the_floor_see_it_as_well(rng, tilt, height):
    found = prior(sticks(rng, looking_down(tilt), height=height, focal_ratio=1.2))
    assert found is not None
    assert found.log_ratio == pytest.approx(np.log(1.2), abs=0.02)


def test_the_standard_deviation_is_true_of_people_who_lean(rng):
    errors = []
    for _ in range(12):
        found = prior(sticks(rng, looking_down(15.0), lean=0.03, places=15))
        errors.append(found.log_ratio / found.stddev)
    assert 0.4 < np.sqrt(np.mean(np.square(errors))) < 1.3


def test_more_places_make_it_surer(rng):
    few, many = (
        prior(sticks(rng, looking_down(20.0), lean=0.04, places=n)).stddev for n in (10, 100)
    )
    assert many < 0.6 * few


@pytest.mark.parametrize(
    "changes",
    [
        {"R_cam_world": looking_down(1.0), "height": 1.2},
        {"R_cam_world": looking_down(20.0), "places": 2},
        {"R_cam_world": looking_down(20.0), "crouch": 0.4},
        {"R_cam_world": looking_down(20.0), "lean": 0.6},
    ],
    ids=["a level camera", "two places", "bent knees", "nobody is upright"],
)
def test_nothing_is_said_of(rng, changes):
    assert prior(sticks(rng, **changes)) is None


def test_nothing_is_said_without_ankles(rng):
    names = [name for name in LAYOUT.joint_names if "ankle" not in name]
    camera = sticks(rng, looking_down(20.0))
    assert focal_length_prior(camera, skeleton_of(layout_from_names(names))) is None


def test_nothing_is_said_where_nobody_is():
    empty = LiftedCamera("cam", np.arange(3.0), ())
    assert prior(empty) is None


def lifted_by_assumed_lenses(options):
    """Cameras of a simulated scene without 3D poses, and the logarithms of the ratios to find."""
    recording = keypoints_only(st.simulate(options).recording)
    blind = every(recording, lambda c: replace(c, intrinsics=assumed_lens(c.intrinsics)))
    skeleton = common_skeleton(blind)
    lifted = lift_recording(blind, skeleton, min_score=0.3)
    true = [
        np.log(c.intrinsics.K[0, 0] / assumed_lens(c.intrinsics).K[0, 0]) for c in recording.cameras
    ]
    return [
        (focal_length_prior(camera, skeleton), t) for camera, t in zip(lifted, true, strict=True)
    ]


@pytest.mark.parametrize("focal_px", [1050.0, 1900.0])
def test_people_who_walk_give_the_focal_length(focal_px):
    options = st.SceneOptions(people="procedural", seed=11, focal_px=focal_px)
    said = [(found, true) for found, true in lifted_by_assumed_lenses(options) if found]
    assert len(said) >= 2
    for found, true in said:
        assert abs(found.log_ratio - true) < min(0.25, 2.5 * found.stddev)


@pytest.mark.parametrize("people", ["standing", "gesturing"])
def test_nothing_is_said_of_people_who_stay_where_they_are(people):
    options = st.SceneOptions(people=people, seed=5, n_frames=150)
    assert all(found is None for found, _ in lifted_by_assumed_lenses(options))
