"""Rotations, lenses and triangulation against closed forms."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stcalib_ros.core.geometry.alignment import best_rotation, best_rotation_trace, umeyama
from stcalib_ros.core.geometry.lens import bearings, project
from stcalib_ros.core.geometry.so3 import (
    exp_so3,
    hat,
    log_so3,
    matrix_from_quaternion,
    quaternion_from_matrix,
    rotation_angle,
)
from stcalib_ros.core.geometry.triangulation import triangulate
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.io.rigs import read_rig

DOME = Path(__file__).parents[4] / "shared/data/camera_rigs/gopro_dome_15.json"
K = np.array([[900.0, 0.0, 655.0], [0.0, 880.0, 340.0], [0.0, 0.0, 1.0]])
STRAIGHT = np.eye(3)
TURNED = Rotation.from_rotvec([0.03, -0.05, 0.02]).as_matrix()


def lens(model: LensModel, D: list[float], R_rect_cam: np.ndarray = STRAIGHT) -> Intrinsics:
    return Intrinsics(1280, 720, model, K, np.array(D), R_rect_cam)


LENSES = {
    "pinhole": lens(LensModel.PLUMB_BOB, []),
    "plumb_bob": lens(LensModel.PLUMB_BOB, [-0.3, 0.12, 0.001, -0.002, -0.02]),
    "rational": lens(LensModel.RATIONAL_POLYNOMIAL, [5.7, 1.6, 1e-4, -2e-4, 0.04, 6.0, 3.5, 0.35]),
    "thin prism": lens(
        LensModel.RATIONAL_POLYNOMIAL,
        [0.3, -0.1, 1e-3, -2e-3, 0.02, 0.5, -0.05, 0.01, 1e-3, -5e-4, 2e-3, 1e-4],
    ),
    "equidistant": lens(LensModel.EQUIDISTANT, [-0.02, 0.01, -0.003, 0.001]),
    "equidistant without coefficients": lens(LensModel.EQUIDISTANT, []),
    "rectified": lens(LensModel.PLUMB_BOB, [], TURNED),
    "rectified and distorted": lens(LensModel.PLUMB_BOB, [-0.2, 0.05, 0, 0, 0], TURNED),
}

vectors = st.lists(st.floats(-3, 3), min_size=3, max_size=3).map(np.array)
rotations = vectors.map(lambda v: Rotation.from_rotvec(v).as_matrix())
seeds = st.integers(0, 2**32 - 1)


def same_up_to(x, y, tolerance):
    np.testing.assert_allclose(x, y, rtol=0, atol=tolerance)


# Rotations


@given(vectors)
def test_the_logarithm_undoes_the_exponential_below_half_a_turn(v):
    v = v * min(1.0, 3.1 / max(np.linalg.norm(v), 1e-9))
    same_up_to(log_so3(exp_so3(v)), v, 1e-9)


def test_the_exponential_is_the_matrix_exponential(rng):
    v = rng.normal(size=(4, 2, 3))
    R = exp_so3(v)
    series, term = np.broadcast_to(np.eye(3), R.shape), np.broadcast_to(np.eye(3), R.shape)
    for n in range(1, 60):
        term = term @ hat(v) / n
        series = series + term
    same_up_to(R, series, 1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 1e-3, 1.0, 3.0, np.pi - 1e-7, np.pi])
def test_the_angle_is_right_near_zero_and_near_half_a_turn(angle, rng):
    axis = rng.normal(size=3)
    R = exp_so3(angle * axis / np.linalg.norm(axis))
    assert rotation_angle(R) == pytest.approx(angle, abs=1e-15 if angle < 1e-6 else 1e-9)


@given(vectors, vectors)
def test_hat_is_the_cross_product(v, w):
    same_up_to(hat(v) @ w, np.cross(v, w), 1e-12)


@given(rotations)
def test_quaternions_are_canonical_and_lead_back(R):
    q = quaternion_from_matrix(R)
    assert q[3] >= 0
    assert np.linalg.norm(q) == pytest.approx(1)
    same_up_to(matrix_from_quaternion(q), R, 1e-12)


def test_quaternions_are_ordered_x_y_z_w():
    R = exp_so3(np.array([0.0, 0.0, np.pi / 2]))
    same_up_to(quaternion_from_matrix(R), [0, 0, np.sqrt(0.5), np.sqrt(0.5)], 1e-12)
    same_up_to(R @ [1, 0, 0], [0, 1, 0], 1e-12)


# Procrustes


@given(rotations, seeds)
def test_best_rotation_turns_directions_b_onto_a(R_a_b, seed):
    v_b = np.random.default_rng(seed).normal(size=(10, 3))
    v_a = v_b @ R_a_b.T
    same_up_to(best_rotation(v_a.T @ v_b), R_a_b, 1e-9)


@given(seeds)
def test_no_rotation_has_a_greater_trace(seed):
    rng = np.random.default_rng(seed)
    S = rng.normal(size=(3, 3))
    R = best_rotation(S)
    assert np.linalg.det(R) == pytest.approx(1)
    others = Rotation.random(200, rng=rng).as_matrix()
    assert np.trace(R.T @ S) >= np.einsum("kij,ij->k", others, S).max() - 1e-12


def svd_trace(S):
    s = np.linalg.svd(S, compute_uv=False)
    return s[..., 0] + s[..., 1] + np.sign(np.linalg.det(S)) * s[..., 2]


@given(seeds, st.floats(1e-3, 1e4))
def test_trace_of_the_best_rotation_is_that_of_the_svd(seed, size):
    S = size * np.random.default_rng(seed).normal(size=(50, 3, 3))
    assert (np.linalg.det(S) < 0).any()
    np.testing.assert_allclose(best_rotation_trace(S), svd_trace(S), rtol=0, atol=1e-6 * size)
    R = best_rotation(S)
    np.testing.assert_allclose(
        best_rotation_trace(S), np.einsum("kij,kij->k", R, S), rtol=0, atol=1e-6 * size
    )


@pytest.mark.parametrize("rank", [0, 1, 2])
def test_trace_of_the_best_rotation_of_degenerate_matrices(rank, rng):
    S = rng.normal(size=(100, 3, rank)) @ rng.normal(size=(100, rank, 3))
    # The smallest eigenvalue of S^T S is exact to 1e-8 of the largest; its root is what counts.
    largest = np.linalg.norm(S, axis=(1, 2)).max()
    same_up_to(best_rotation_trace(S), svd_trace(S), 3e-4 * largest + 1e-70)


@pytest.mark.parametrize("values", [(1, 1, 1), (1, 1, -1), (2, 1, 1), (2, 2, 1), (2, 2, -2)])
def test_trace_of_the_best_rotation_with_equal_singular_values(values):
    U, V = Rotation.random(2, rng=np.random.default_rng(1)).as_matrix()
    S = U @ np.diag(np.array(values, float)) @ V.T
    assert best_rotation_trace(S) == pytest.approx(sum(values), abs=1e-6)


# Lenses


@pytest.mark.parametrize("name", LENSES)
def test_bearings_undo_projection(name, rng):
    x = rng.uniform([-0.6, -0.35], [0.6, 0.35], (200, 2))
    pixels = project(np.concatenate([x, np.ones((200, 1))], -1), LENSES[name])
    back, _ = bearings(pixels, LENSES[name])
    same_up_to(back, x, 1e-9)


@pytest.mark.parametrize("name", LENSES)
def test_focal_is_the_root_of_the_area_that_the_lens_makes_of_a_unit(name, rng):
    x = rng.uniform([-0.5, -0.3], [0.5, 0.3], (20, 2))

    def image(points):
        return project(np.concatenate([points, np.ones((len(points), 1))], -1), LENSES[name])

    h = 1e-5
    J = np.stack([(image(x + h * e) - image(x - h * e)) / (2 * h) for e in np.eye(2)], -1)
    _, focal = bearings(image(x), LENSES[name])
    np.testing.assert_allclose(focal, np.sqrt(np.abs(np.linalg.det(J))), rtol=1e-6)


def test_focal_of_a_pinhole_is_the_geometric_mean():
    _, focal = bearings(np.array([[100.0, 50.0], [700.0, 600.0]]), LENSES["pinhole"])
    np.testing.assert_allclose(focal, np.sqrt(900.0 * 880.0), rtol=1e-8)


def test_a_pinhole_divides_by_depth():
    same_up_to(
        project(np.array([0.5, -0.25, 2.0]), LENSES["pinhole"]),
        [655 + 900 * 0.25, 340 - 880 * 0.125],
        1e-9,
    )


def test_rectified_key_points_are_those_of_the_turned_frame(rng):
    points = rng.uniform([-1, -1, 3], [1, 1, 6], (20, 3))
    turned = points @ TURNED.T
    same_up_to(project(points, LENSES["rectified"]), project(turned, LENSES["pinhole"]), 1e-9)
    x, _ = bearings(project(points, LENSES["rectified"]), LENSES["rectified"])
    same_up_to(x, points[:, :2] / points[:, 2:], 1e-9)


def test_what_was_not_seen_stays_unknown():
    pixels = np.array([[[np.nan, np.nan], [600.0, 300.0]], [[np.nan, 3.0], [650.0, 310.0]]])
    for name, lens_ in LENSES.items():
        x, focal = bearings(pixels, lens_)
        assert x.shape == (2, 2, 2), name
        assert np.isnan(x[:, 0]).all(), name
        assert np.isnan(focal[:, 0]).all(), name
        assert np.isfinite(x[:, 1]).all(), name
        assert np.isfinite(focal[:, 1]).all(), name


def test_nothing_at_all_gives_nothing():
    for lens_ in LENSES.values():
        x, focal = bearings(np.zeros((0, 17, 2)), lens_)
        assert x.shape == (0, 17, 2)
        assert focal.shape == (0, 17)


def test_points_behind_the_camera_have_no_image():
    points = np.array([[0.1, 0.1, -2.0], [0.0, 0.0, 0.0], [np.nan, 0.0, 2.0], [0.1, 0.1, 2.0]])
    seen = np.isfinite(project(points, LENSES["plumb_bob"])).all(-1)
    assert seen.tolist() == [False, False, False, True]


def test_pixels_that_no_ray_reaches_have_no_bearing():
    # This lens folds back: its image ends where r (1 - 0.3 r^2) is greatest.
    folded = lens(LensModel.PLUMB_BOB, [-0.3, 0, 0, 0])
    r = 1 / np.sqrt(0.9)
    edge = r * (1 - 0.3 * r**2)
    outside = K[:2, 2] + K[0, 0] * np.array([[1.05 * edge, 0.0], [2 * edge, 0.0]])
    assert np.isnan(bearings(outside, folded)[0]).all()
    inside = K[:2, 2] + K[0, 0] * np.array([[0.9 * edge, 0.0]])
    x, _ = bearings(inside, folded)
    assert 0 < x[0, 0] < r


@pytest.mark.skipif(not DOME.exists(), reason="the rigs of the shared data are not here")
def test_the_wide_lens_of_a_real_rig_is_inverted():
    camera = read_rig(DOME).intrinsics[0]
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, 25), np.linspace(0, camera.height - 1, 15))
    pixels = np.stack([u, v], -1)
    x, focal = bearings(pixels, camera)
    known = np.isfinite(x).all(-1)
    assert known.mean() > 0.97
    rays = np.concatenate([x, np.ones_like(x[..., :1])], -1)[known]
    image, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera.K, camera.D)
    same_up_to(image[:, 0], pixels[known], 1e-2)
    assert (focal[known] > 0).all()
    inner = np.linalg.norm(x[known], axis=-1) < 1.9  # 62 degrees off the axis
    assert inner.mean() > 0.9
    same_up_to(image[inner, 0], pixels[known][inner], 1e-6)
    again, _ = bearings(project(rays[inner], camera), camera)
    same_up_to(again, rays[inner, :2], 1e-9)


# Triangulation


def rays_to(points, centres):
    away = points[..., None, :] - centres
    return away / np.linalg.norm(away, axis=-1, keepdims=True)


@given(seeds, st.integers(2, 6))
def test_triangulation_is_exact_for_exact_rays(seed, n_cameras):
    rng = np.random.default_rng(seed)
    centres = rng.uniform(-4, 4, (n_cameras, 3))
    points = rng.uniform([-2, -2, 6], [2, 2, 10], (5, 3))
    X, good = triangulate(centres, rays_to(points, centres), np.ones((5, n_cameras)))
    same_up_to(X, points, 1e-6)
    assert good.all()


def test_cameras_of_weight_zero_are_not_asked(rng):
    centres, points = rng.uniform(-3, 3, (3, 3)), np.array([[0.0, 0.0, 9.0]])
    rays = rays_to(points, centres)
    rays[0, 1] = np.nan
    X, good = triangulate(centres, rays, np.array([[1.0, 0.0, 1.0]]))
    same_up_to(X, points, 1e-9)
    assert good.all()


def test_two_skew_rays_of_equal_length_meet_half_way():
    centres = np.array([[-1.0, 0.0, 0.0], [1.0, 0.2, 0.0]])
    rays = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 1.0]])
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    X, _ = triangulate(centres, rays, np.ones(2), refinements=0)
    same_up_to(X, [-1.0, 0.1, 2.0], 1e-9)


@pytest.mark.parametrize("weights", [[0.0, 0.0], [1.0, 0.0]])
def test_one_ray_is_not_enough(weights):
    centres = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    rays = rays_to(np.array([0.0, 0.0, 5.0]), centres)
    X, good = triangulate(centres, rays, np.array(weights))
    assert not good
    assert np.isnan(X).all()


def test_parallel_rays_meet_nowhere():
    centres = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    X, good = triangulate(centres, np.array([[0.0, 0.0, 1.0]] * 2), np.ones(2))
    assert not good
    assert np.isnan(X).all()


def test_a_point_behind_a_camera_is_not_good():
    centres = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    rays = -rays_to(np.array([0.3, 0.0, 5.0]), centres)
    X, good = triangulate(centres, rays, np.ones(2), refinements=0)
    assert not good
    same_up_to(X, [0.3, 0.0, 5.0], 1e-9)


# Similarity


@given(rotations, vectors, st.floats(0.1, 10), seeds)
def test_umeyama_finds_the_similarity(R, t, s, seed):
    source = np.random.default_rng(seed).normal(size=(8, 3))
    s_, R_, t_ = umeyama(source, s * source @ R.T + t)
    assert s_ == pytest.approx(s, rel=1e-9)
    same_up_to(R_, R, 1e-9)
    same_up_to(t_, t, 1e-8)


def test_umeyama_is_a_least_squares_optimum(rng):
    source, target = rng.normal(size=(2, 12, 3))

    def cost(s, R, t):
        return ((s * source @ R.T + t - target) ** 2).sum()

    best = umeyama(source, target)
    for _ in range(100):
        nearby = (
            best[0] * (1 + 0.01 * rng.normal()),
            exp_so3(0.01 * rng.normal(size=3)) @ best[1],
            best[2] + 0.01 * rng.normal(size=3),
        )
        assert cost(*nearby) > cost(*best)


def test_umeyama_never_reflects(rng):
    source = rng.normal(size=(10, 3))
    _, R, _ = umeyama(source, source * [1, 1, -1])
    assert np.linalg.det(R) == pytest.approx(1)
