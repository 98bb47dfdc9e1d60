"""Two views, from oriented points to rotation, offset, association and translation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.paper.windows import register_on_windows
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.lifting.views import lift_views
from stcalib_ros.core.options import Options, RegistrationOptions, VmfOptions
from stcalib_ros.core.paper.oriented import oriented_points, samples_of, spread_windows, take
from stcalib_ros.core.paper.registration import source_model
from stcalib_ros.core.paper.vmf import fit
from stcalib_ros.core.synthetic import SceneOptions, paper_scene

FRAME_S = 1 / 30


def options(method="vmf", **vmf):
    return Options(
        registration=RegistrationOptions(method=method), vmf=VmfOptions(**({"window": 5} | vmf))
    )


def registered(scene, a, b, starts, o, *, max_lag=6, seed=0):
    views = lift_views(scene.recording, o)
    rng = np.random.default_rng(seed)
    return register_on_windows(views, a, b, starts, o, max_lag=max_lag, rng=rng)


def relative(scene, a, b):
    one, other = scene.truth.cameras[a], scene.truth.cameras[b]
    t = one.R_ref_cam.T @ (other.t_ref_cam - one.t_ref_cam)
    lag_s = one.time_offset_s - other.time_offset_s
    return one.R_ref_cam.T @ other.R_ref_cam, t, lag_s


@pytest.fixture(scope="module")
def points(noise_free):
    views = lift_views(noise_free.recording, options())
    return oriented_points(views.lifted[0], views.skeleton, start=0.0, step=FRAME_S, n=60)


def test_oriented_points_are_unit_vectors_from_parent_to_joint(noise_free, points):
    track = noise_free.recording.cameras[0].tracks[1]
    parents = noise_free.recording.cameras[0].layout.parents
    bones = np.stack(
        [track.joints[:, j] - track.joints[:, p] for j, p in enumerate(parents) if p >= 0], 1
    )
    expected = bones / np.linalg.norm(bones, axis=-1, keepdims=True)
    assert points.v.shape == (3, 60, 16, 3)
    assert points.v[1, track.frames] == pytest.approx(expected, abs=1e-6)
    assert points.known.min() == 1.0


def test_the_model_at_an_offset_is_the_fit_of_the_shifted_window(points):
    starts, lags = np.array([4, 40, 55]), np.array([-6, 0, 3])
    model, seen = source_model(points, starts, lags, 5)
    for i, lag in enumerate(lags):
        for w, start in enumerate(starts):
            window = points.v[:, max(start + lag, 0) : max(start + lag + 5, 0)]
            n = window.shape[1]
            expected = fit(window.sum(1), np.full(window[:, 0].shape[:-1], float(n)))
            assert model.mu[:, i, w] == pytest.approx(expected.mu, abs=1e-9)
            assert model.kappa[:, i, w] == pytest.approx(expected.kappa, rel=1e-6)
            assert seen[:, i, w].tolist() == [n >= 2] * 3


def test_windows_are_uniform_and_do_not_overlap():
    assert spread_windows(60, 5, 4).tolist() == [0, 18, 37, 55]
    assert spread_windows(60, 15, 20).tolist() == [0, 15, 30, 45]
    assert spread_windows(4, 15, 20).tolist() == [0]


def test_samples_outside_of_the_recording_are_empty():
    values = np.arange(1.0, 5.0)[None, :, None]
    found = take(values, samples_of([0, 3], 2, np.array([-1, 0])))
    assert found[0, ..., 0].tolist() == [[[0, 1], [3, 4]], [[1, 2], [4, 0]]]


@pytest.mark.parametrize("initial", ["random", "candidates"])
@pytest.mark.parametrize("n_hypothesised", [0, 2])
@pytest.mark.parametrize(("a", "b"), [(0, 1), (1, 2), (2, 0)])
def test_without_noise_everything_is_found(noise_free, a, b, n_hypothesised, initial):
    o = options(initial=initial, n_hypothesised=n_hypothesised, n_starts=20)
    found = registered(noise_free, a, b, [8, 22, 36, 48], o)
    R, t, lag_s = relative(noise_free, a, b)
    h = found.hypothesis
    assert h.lag_s == pytest.approx(lag_s, abs=1e-9)
    assert h.matches == ((0, 0), (1, 1), (2, 2))
    assert found.matches.tolist() == [[w, p, p] for w in range(4) for p in range(3)]
    assert rotation_angle(R.T @ h.R_a_b) < 0.02
    assert h.t_a_b == pytest.approx(t, abs=0.03 * np.linalg.norm(t))
    assert found.cost_rad < 0.05


def test_one_window_with_the_papers_noise(noisy):
    errors = []
    for method in ("vmf", "correlation"):
        found = [
            registered(noisy, a, b, [s], options(method), max_lag=10)
            for a, b in ((0, 1), (0, 2), (1, 2))
            for s in (20, 50)
        ]
        errors.append(
            [
                float(rotation_angle(relative(noisy, f.hypothesis.a, f.hypothesis.b)[0].T @ R))
                for f in found
                if (R := f.hypothesis.R_a_b) is not None
            ]
        )
    assert np.mean(errors[0]) < 0.03
    assert np.mean(errors[1]) < 0.015
    assert np.max(errors) < 0.1


def test_windows_taken_together_are_better_than_one(noisy):
    R, _, lag_s = relative(noisy, 0, 1)
    found = registered(noisy, 0, 1, range(10, 80, 5), options(), max_lag=10)
    assert found.hypothesis.lag_s == pytest.approx(lag_s, abs=1e-9)
    assert rotation_angle(R.T @ found.hypothesis.R_a_b) < 0.006


@pytest.fixture(scope="module")
def strangers():
    """Two cameras that have two people in common, and see two strangers each beside them."""
    options = SceneOptions(n_cameras=2, n_people=6, n_frames=60, seed=5)
    return paper_scene(options, hidden={0: [4, 5], 1: [2, 3]})


def test_ransac_leaves_out_people_whom_the_other_camera_does_not_see(strangers):
    R, _, lag_s = relative(strangers, 0, 1)
    found, plain = (
        registered(strangers, 0, 1, [15, 25, 35], options(n_hypothesised=n), max_lag=8).hypothesis
        for n in (2, 0)
    )
    lifted = lift_views(strangers.recording, options()).lifted
    matched = {
        (lifted[0].tracks[p].track_id, lifted[1].tracks[q].track_id) for p, q in found.matches
    }
    assert matched == {(0, 0), (1, 1)}
    assert found.lag_s == pytest.approx(lag_s, abs=1e-9)
    assert rotation_angle(R.T @ found.R_a_b) < 0.02
    assert len(plain.matches) > 2
    assert rotation_angle(R.T @ plain.R_a_b) > 2 * rotation_angle(R.T @ found.R_a_b)


def test_the_seed_decides(noisy):
    one, same, other = (
        registered(noisy, 0, 1, [30], options(n_starts=2), seed=s).hypothesis for s in (1, 1, 2)
    )
    assert np.array_equal(one.R_a_b, same.R_a_b)
    assert rotation_angle(one.R_a_b.T @ other.R_a_b) < 1.0


@pytest.mark.parametrize("method", ["vmf", "correlation"])
def test_nobody_to_compare_is_no_registration(noise_free, method):
    recording = noise_free.recording
    empty = replace(recording.cameras[1], tracks=())
    scene = replace(noise_free, recording=replace(recording, cameras=(recording.cameras[0], empty)))
    assert registered(scene, 0, 1, [10], options(method)) is None


@pytest.mark.parametrize("starts", [[], [-1], [56]])
def test_windows_outside_of_the_recording_are_refused(noise_free, starts):
    with pytest.raises(InputError, match=r"windows of 5 frames from .*: cam0 has 60 frames"):
        registered(noise_free, 0, 1, starts, options())


def test_the_default_uses_nothing_outside_of_the_windows(noise_free):
    o = options("correlation", window=10)
    views = lift_views(noise_free.recording, o)
    rng = np.random.default_rng(0)
    whole = register_on_windows(views, 0, 1, [5, 30], o, max_lag=6, rng=rng)

    def spoilt(track):
        rows = np.isin(track.frames, [*range(5, 15), *range(30, 40)])
        joints = np.where(rows[:, None, None], track.joints_cam, track.joints_cam[:1])
        x = np.where(rows[:, None, None], track.x, 0.1)
        return replace(track, joints_cam=joints, x=x)

    target = replace(views.lifted[0], tracks=tuple(spoilt(t) for t in views.lifted[0].tracks))
    views = replace(views, lifted=(target, *views.lifted[1:]))
    again = register_on_windows(views, 0, 1, [5, 30], o, max_lag=6, rng=rng)
    assert np.array_equal(whole.hypothesis.R_a_b, again.hypothesis.R_a_b)
    assert np.array_equal(whole.hypothesis.t_a_b, again.hypothesis.t_a_b)
    assert whole.hypothesis.lag_s == pytest.approx(relative(noise_free, 0, 1)[2], abs=0.02)
    assert whole.matches.tolist() == [[w, p, p] for w in range(2) for p in range(3)]
