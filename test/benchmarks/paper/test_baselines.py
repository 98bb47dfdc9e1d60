"""The systems that the paper compares with: exact where their input is."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from benchmarks.paper import background
from benchmarks.paper.arcs import arcs, most_stabbed, proposals, rotation_about
from benchmarks.paper.background import background_views
from benchmarks.paper.boards import show_boards
from benchmarks.paper.classical import eight_point, pnp
from benchmarks.paper.point_bundle import PointViews, adjusted, rig_of
from benchmarks.paper.reid import (
    embeddings,
    matched,
    noise_for,
    prototypes,
    rank_1_of,
    relative_pose,
)
from benchmarks.paper.sfm import SfmFailure, incremental_sfm
from benchmarks.paper.vo import calibrate_vo
from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.synthetic import SceneOptions, SceneRig, simulate
from stcalib_ros.core.synthetic.rigs import ring_rig


def ring(seed: int = 0, n: int = 4) -> SceneRig:
    return ring_rig(
        np.random.default_rng(seed),
        n,
        image_size=(1920, 1080),
        focal_px=1400.0,
        radius_m=(4.0, 5.0),
        height_m=(1.5, 2.8),
    )


def relative(rig: SceneRig, a: int, b: int) -> tuple[np.ndarray, np.ndarray]:
    R = rig.R_cam_world[a] @ rig.R_cam_world[b].T
    return R, rig.t_cam_world[a] - R @ rig.t_cam_world[b]


def directions(seed: int, *shape: int) -> np.ndarray:
    v = np.random.default_rng(seed).standard_normal((*shape, 3))
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


intervals = st.lists(
    st.tuples(st.floats(-10, 10), st.floats(0, 2 * np.pi + 1)), min_size=1, max_size=12
)


@given(intervals)
@example([(0.0, 0.0), (-2.2250738585072014e-308, 6.450266809048073e-69)])
@settings(max_examples=200, deadline=None)
def test_most_stabbed_counts_as_a_fine_grid_does(given_intervals) -> None:
    low = np.array([a for a, _ in given_intervals])
    high = low + np.array([w for _, w in given_intervals])
    period = 2 * np.pi
    point, count = most_stabbed(low, high, period=period)
    inside = (point - low) % period <= high - low + 1e-9
    assert inside.sum() >= count
    grid = np.linspace(0, period, 2000, endpoint=False)
    depth = (((grid[:, None] - low) % period) <= high - low).sum(1)
    assert count >= depth.max()


def test_arcs_finds_the_rotation_among_false_correspondences() -> None:
    R = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    v_b = directions(0, 4, 3, 8)
    order = [2, 0, 3, 1]
    v_a = (v_b @ R.T)[order]
    known = np.ones(v_b.shape[:-1], dtype=bool)
    left, right = proposals(v_a, known, v_b, known)
    assert len(left) == 4 * 4 * 3 * 8
    found = arcs(left, right)
    assert rotation_angle(found.R_a_b.T @ R) < 1e-3
    assert found.n_inliers >= len(left) / 4


def test_proposals_leave_out_what_is_unknown() -> None:
    v = directions(1, 2, 1, 3)
    known = np.ones((2, 1, 3), dtype=bool)
    known[1, 0, 2] = False
    left, _ = proposals(v, known, v, known)
    assert len(left) == 2 * 4 + 1


@given(st.floats(-3.1, 3.1))
@settings(max_examples=30, deadline=None)
def test_angle_about_a_known_axis(angle) -> None:
    axis = directions(2, 1)[0]
    v_b = directions(3, 30)
    v_a = v_b @ Rotation.from_rotvec(angle * axis).as_matrix().T
    found = rotation_about(axis, v_a, v_b, 0.05)
    assert abs(np.angle(np.exp(1j * (found - angle)))) < 0.05


def test_appearance_is_right_as_often_as_stated() -> None:
    for n in (2, 6):
        assert rank_1_of(noise_for(0.8, n), n) == pytest.approx(0.8, abs=0.02)


def test_people_who_look_like_themselves_are_matched() -> None:
    rng = np.random.default_rng(0)
    looks = prototypes(rng, 5)
    e_a, e_b = (
        embeddings(rng, order, looks, 0.01) for order in (np.arange(5), np.array([3, 1, 0]))
    )
    assert sorted(matched(e_a, e_b)) == [(0, 2), (1, 1), (3, 0)]


def test_wrong_matches_are_given_up_by_the_essential_matrix() -> None:
    rig, rng = ring(), np.random.default_rng(5)
    X = rng.uniform(-0.8, 0.8, (4, 20, 17, 3)) + np.array([0, 0, 1.0])
    x_a, x_b = (
        y[..., :2] / y[..., 2:]
        for y in (X @ rig.R_cam_world[c].T + rig.t_cam_world[c] for c in (0, 1))
    )
    found = relative_pose(0, 1, x_a, x_b, [(0, 0), (1, 1), (2, 2), (3, 0)], 1400.0)
    assert found is not None
    R, t = relative(rig, 0, 1)
    assert rotation_angle(found.R_a_b.T @ R) < 1e-3
    assert found.t_a_b @ t / np.linalg.norm(t) > 0.9999
    assert found.matches == ((0, 0), (1, 1), (2, 2))
    assert relative_pose(0, 1, x_a * np.nan, x_b, [(0, 0)], 1400.0) is None


@pytest.fixture(scope="module")
def shots():
    rig = ring(1)
    return rig, show_boards(np.random.default_rng(1), rig, per_pair=4, sigma_px=0.0)


def test_boards_are_seen_by_their_pair(shots) -> None:
    _, boards = shots
    assert len(boards.pair) == 6 * 4
    assert np.take_along_axis(boards.observed, boards.pair, axis=1).all()
    only = boards.of_pairs_only()
    assert (only.observed.all(2).sum(1) == 2).all()


def test_boards_without_noise_give_exact_pairs(shots) -> None:
    rig, boards = shots
    for a, b in combinations(range(4), 2):
        R, t = relative(rig, a, b)
        for found in (eight_point(boards, a, b), pnp(boards, rig, a, b)):
            assert rotation_angle(found.R_a_b.T @ R) < 1e-4
            np.testing.assert_allclose(found.t_a_b, t, atol=2e-3)


def test_structure_from_motion_without_noise_is_exact(shots) -> None:
    rig, boards = shots
    found = incremental_sfm(boards.views)
    R, t = relative(rig, 0, 2)
    unit = np.linalg.norm(relative(rig, 0, 1)[1])
    assert rotation_angle(found.rig.R_ref_cam[2].T @ R) < 1e-4
    np.testing.assert_allclose(found.rig.t_ref_cam[2] * unit, t, atol=1e-3)
    assert found.mean_px < 1e-2


def test_adjustment_brings_a_disturbed_rig_back(shots) -> None:
    rig, boards = shots
    R = np.stack([relative(rig, 0, c)[0] for c in range(4)])
    t = np.stack([relative(rig, 0, c)[1] for c in range(4)])
    off = Rotation.from_rotvec(0.01 * directions(4, 4)).as_matrix()
    off[0] = np.eye(3)
    found = adjusted(boards.views, rig_of(off @ R, t))
    assert rotation_angle(np.swapaxes(found.rig.R_ref_cam, 1, 2) @ R).max() < 1e-4


def test_background_that_nobody_shares_gives_no_rig() -> None:
    views = background_views(np.random.default_rng(0), ring(3))
    nothing = PointViews(views.x, views.observed & (np.arange(4) == 0)[:, None], views.focal)
    with pytest.raises(SfmFailure, match="no initial image pair"):
        incremental_sfm(nothing)


def test_a_camera_that_sees_one_plane_alone_is_not_mirrored() -> None:
    rng = np.random.default_rng(2)
    floor = np.column_stack([rng.uniform(-2, 2, (60, 2)), np.zeros(60)])
    raised = np.column_stack([rng.uniform(-2, 2, (60, 2)), rng.uniform(0, 2, 60)])
    rig = ring(3)
    x = np.zeros((120, len(rig.names), 1, 2))
    for c, (R, t) in enumerate(zip(rig.R_cam_world, rig.t_cam_world, strict=True)):
        points = np.concatenate([floor, raised]) @ R.T + t
        x[:, c, 0] = points[:, :2] / points[:, 2:]
    seen = np.ones(x.shape[:3], dtype=bool)
    seen[60:, 2:] = False
    found = incremental_sfm(PointViews(x, seen, np.full(len(rig.names), 1400.0)))
    for c in range(1, len(rig.names)):
        assert rotation_angle(found.rig.R_ref_cam[c].T @ relative(rig, 0, c)[0]) < 1e-5


def test_vo_with_close_cameras_finds_poses_and_clocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(background, "N_POINTS", 1000)
    angles = np.deg2rad([0.0, 20.0, 40.0])
    near = ring(7, 12)
    centre = np.stack([4.5 * np.cos(angles), 4.5 * np.sin(angles), 1.5 + 0.3 * np.arange(3)], 1)
    ahead = -centre + [0, 0, 1.0]
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    right = np.cross(ahead, [0, 0, 1.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    R = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    rig = SceneRig(("a", "b", "c"), near.intrinsics[:3], R, -np.einsum("cij,cj->ci", R, centre))
    scene = simulate(SceneOptions(rig=rig, n_people=2, n_frames=90, max_offset_frames=3.0, seed=4))
    found = calibrate_vo(np.random.default_rng(0), scene.recording, scene.truth, scene.rig)
    true = np.array([c.time_offset_s for c in scene.truth.cameras])
    np.testing.assert_allclose(found.rig.offset_s, true, atol=0.3 / 30)
    R_true = np.stack([c.R_ref_cam for c in scene.truth.cameras])
    assert rotation_angle(np.swapaxes(found.rig.R_ref_cam, 1, 2) @ R_true).max() < 0.01
