"""Simulated errors against their closed forms."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stcalib_ros.core.synthetic import tracking
from stcalib_ros.core.synthetic.detector import DetectorBias, displaced
from stcalib_ros.core.synthetic.lifter import LifterErrors, crop_rotation, joint_errors, lift
from stcalib_ros.core.synthetic.noise import child_rng, smooth_noise
from stcalib_ros.core.synthetic.skeleton import LAYOUT, body_axes
from stcalib_ros.io.mocap import shipped_clips

TIMES = np.arange(300) / 30


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.fixture
def joints_cam():
    """A person 4 m from the camera and 1 m to the right of its axis."""
    body = np.resize(shipped_clips()[0].joints, (300, 17, 3))
    R_cam_world = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    return (body - body[:, :1]) @ R_cam_world.T + [1.0, 0.2, 4.0]


def unit_vectors(rng, n):
    v = rng.standard_normal((n, 3))
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def test_smooth_noise_has_unit_variance_and_the_stated_correlation(rng):
    tau = 0.5
    x = smooth_noise(rng, np.arange(0, 10, 0.1), (4000,), tau)
    assert abs(x.mean()) < 0.02
    assert x.var() == pytest.approx(1, abs=0.03)
    for lag in (2, 5, 10):
        measured = np.mean(x[:-lag] * x[lag:])
        assert measured == pytest.approx(np.exp(-((0.1 * lag) ** 2) / (4 * tau**2)), abs=0.03)


def test_child_generators_are_independent_and_reproducible():
    a, b = (child_rng(np.random.default_rng(3)) for _ in range(2))
    assert a.uniform() == b.uniform()
    parent = np.random.default_rng(3)
    assert child_rng(parent).uniform() != child_rng(parent).uniform()


def test_detector_bias_has_the_stated_size_and_no_constant_part(rng):
    directions = unit_vectors(rng, 40_000)
    for _ in range(3):
        b = DetectorBias(rng, 0.02)(directions)
        # Of each joint the mean square over the three axes is the square of the bias.
        np.testing.assert_allclose(np.sqrt((b**2).mean(axis=(0, 2))), 0.02, rtol=0.03)
        assert np.abs(b.mean(axis=0)).max() < 0.001


def test_detector_bias_is_a_polynomial_of_degree_two(rng):
    bias, u = DetectorBias(rng, 0.02), unit_vectors(rng, 200)
    x, y, z = u.T
    basis = np.stack([x, y, z, x * x, y * y, z * z, x * y, x * z, y * z], axis=-1)
    values = bias(u).reshape(200, -1)
    fit = basis @ np.linalg.lstsq(basis, values, rcond=None)[0]
    np.testing.assert_allclose(fit, values, atol=1e-12)


def test_displacement_turns_with_the_body(rng, joints_cam):
    bias = DetectorBias(rng, 0.02)
    R = Rotation.random(rng=1).as_matrix()
    moved = displaced(joints_cam @ R.T, bias)
    np.testing.assert_allclose(moved, displaced(joints_cam, bias) @ R.T, atol=1e-12)


def test_displacement_is_that_of_the_direction_to_the_camera(rng, joints_cam):
    bias, axes = DetectorBias(rng, 0.02), body_axes(joints_cam)
    toward = np.einsum("tab,tb->ta", axes, -joints_cam[:, 0])
    toward /= np.linalg.norm(toward, axis=-1, keepdims=True)
    shift = np.einsum("tab,tjb->tja", axes, displaced(joints_cam, bias) - joints_cam)
    np.testing.assert_allclose(shift, bias(toward), atol=1e-12)


@pytest.mark.parametrize("mpjpe_m", [0.03, 0.06])
def test_joint_errors_have_the_stated_mean_distance(rng, mpjpe_m):
    error = joint_errors(rng, TIMES, mpjpe_m, 1.5)
    assert np.linalg.norm(error, axis=-1).mean() == pytest.approx(mpjpe_m, rel=1e-12)
    assert not error[:, LAYOUT.index("pelvis")].any()


def test_joint_errors_are_alike_in_time_and_along_limbs(rng):
    errors = np.stack([joint_errors(rng, TIMES, 0.04, 1.0) for _ in range(200)])
    wrist, elbow = (errors[:, :, LAYOUT.index(f"left_{j}")] for j in ("wrist", "elbow"))

    def correlation(a, b):
        return float(np.sum(a * b) / np.sqrt(np.sum(a * a) * np.sum(b * b)))

    assert correlation(wrist[:, 1:], wrist[:, :-1]) > 0.9
    assert 0.2 < correlation(wrist[:, 60:], wrist[:, :-60]) < 0.35
    assert correlation(wrist, elbow) > 0.5


def test_joint_errors_are_larger_in_depth(rng):
    errors = np.stack([joint_errors(rng, TIMES, 0.04, 2.0) for _ in range(300)])
    rms = np.sqrt((errors**2).mean(axis=(0, 1, 2)))
    assert rms[2] / rms[:2].mean() == pytest.approx(2, rel=0.1)


def test_crop_rotation_turns_the_bearing_to_the_axis(joints_cam):
    root = joints_cam[:, 0]
    bearing = root / np.linalg.norm(root, axis=-1, keepdims=True)
    np.testing.assert_allclose(crop_rotation(root, 1.0).apply(bearing)[:, 2], 1, atol=1e-12)
    half = crop_rotation(root, 0.5).magnitude()
    np.testing.assert_allclose(half, np.arccos(bearing[:, 2]) / 2, atol=1e-9)
    assert not crop_rotation(np.array([[0.0, 0.0, 4.0]]), 1.0).magnitude().any()


def test_a_perfect_lifter_returns_the_pose_relative_to_the_root(rng, joints_cam):
    perfect = LifterErrors(mpjpe_m=0, depth_ratio=1, tilt_rad=0, crop=0, scale=1)
    lifted = lift(rng, TIMES, joints_cam, perfect)
    np.testing.assert_allclose(lifted, joints_cam - joints_cam[:, :1], atol=1e-12)


def test_tilt_and_scale_have_the_stated_size(rng, joints_cam):
    relative = joints_cam - joints_cam[:, :1]
    angles = []
    for _ in range(200):
        errors = LifterErrors(mpjpe_m=0, depth_ratio=1, tilt_rad=0.05, crop=0, scale=1.1)
        lifted = lift(rng, TIMES, joints_cam, errors)
        np.testing.assert_allclose(
            np.linalg.norm(lifted, axis=-1), 1.1 * np.linalg.norm(relative, axis=-1), atol=1e-9
        )
        R, _ = Rotation.align_vectors(lifted[0], 1.1 * relative[0])
        angles.append(R.magnitude())
    assert np.sqrt(np.mean(np.square(angles))) == pytest.approx(0.05, rel=0.15)


@pytest.mark.parametrize("share", [0.1, 0.25, 0.5])
def test_missing_stretches_make_up_the_stated_share(rng, share):
    times = np.arange(0, 60, 0.1)
    hidden = tracking.missing_stretches(rng, times, 300, share)
    assert hidden.mean() == pytest.approx(share, rel=0.1)
    changes = np.count_nonzero(np.diff(hidden, axis=0))
    assert changes < 300 * 60


def test_people_behind_others_are_hidden():
    boxes = np.array([[[0, 0, 100, 200], [10, 10, 90, 190], [300, 0, 400, 200.0]]])
    depth = np.array([[2.0, 4.0, 5.0]])
    assert tracking.hidden_behind(boxes, depth).tolist() == [[False, True, False]]
    assert not tracking.hidden_behind(boxes[:, ::-1], depth)[0, 1:].all()


def test_boxes_enclose_what_is_seen():
    keypoints = np.full((1, 2, 3, 2), np.nan)
    keypoints[0, 0, :2] = [[1, 5], [3, 2]]
    boxes = tracking.boxes_of(keypoints)
    np.testing.assert_array_equal(boxes[0, 0], [1, 2, 3, 5])
    assert np.isnan(boxes[0, 1]).all()


def test_a_long_gap_starts_a_new_track_and_a_short_one_does_not():
    visible = np.ones((300, 2), dtype=bool)
    visible[100:105, 0] = False
    visible[200:230, 1] = False
    ids = tracking.fragment_ids(TIMES, visible)
    assert set(ids[visible[:, 0], 0]) == {0}
    assert set(ids[:200, 1]) == {1}
    assert set(ids[230:, 1]) == {2}
    assert (ids[~visible] == -1).all()


def test_ids_are_exchanged_where_boxes_are_close(rng):
    ids = np.tile(np.array([0, 1]), (300, 1))
    left = np.stack([np.full(300, 500.0), 500 + 20 * np.abs(np.arange(300) - 150.0)], axis=-1)
    boxes = np.stack([left, np.zeros_like(left), left + 100, np.full_like(left, 300)], axis=-1)
    at = []
    for _ in range(200):
        switched = tracking.switch_ids(rng, TIMES, ids, boxes, 0.1)
        assert (np.sort(switched, axis=1) == ids).all()
        at += np.flatnonzero(np.diff(switched[:, 0])).tolist()
    # Two persons, ten seconds, 0.1 per person and second: one exchange, Poisson.
    assert len(at) == pytest.approx(200, abs=5 * np.sqrt(200))
    assert np.median(np.abs(np.array(at) - 150)) < 10


def test_nobody_to_exchange_with(rng):
    ids = np.zeros((300, 1), dtype=np.int64)
    boxes = np.zeros((300, 1, 4))
    np.testing.assert_array_equal(tracking.switch_ids(rng, TIMES, ids, boxes, 5.0), ids)
