"""Lengths of limbs: constant where cameras are right, and not where they are wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import HALF_SECOND, SMALL

from stcalib_ros.core.bundle.state import initial_state
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.rig import sub_rig
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.synthetic import simulate
from stcalib_ros.core.validation.limb_lengths import limb_variations


@pytest.fixture(scope="module")
def last(small_stages):
    return small_stages.iterations[-1]


def of_two(last):
    """The first two cameras alone."""
    obs, state = last.observations, last.state
    names = ("track", "phi", "x", "focal", "observed")
    two = replace(obs, **{name: getattr(obs, name)[:, :2] for name in names})
    poses = {n: getattr(state, n)[:2] for n in ("R_cam_ref", "t_cam_ref", "shift_s")}
    seen = state.inlier[:, :2]
    state = replace(state, **poses, inlier=seen & (seen.sum(1) >= 2)[:, None])
    return replace(last, rig=sub_rig(last.rig, [0, 1]), observations=two, state=state)


def triangulated_with(last, turned):
    """Everything triangulated anew, the second camera turned about its own centre."""
    R = last.rig.R_ref_cam.copy()
    R[1] = R[1] @ exp_so3(np.asarray(turned))
    rig = replace(last.rig, R_ref_cam=R)
    return replace(last, rig=rig, state=initial_state(last.observations, rig))


def test_limbs_of_right_cameras_keep_their_length(small_stages, last):
    found = limb_variations(small_stages.skeleton, last)
    assert found.shape == (3,)
    assert found.max() < 0.03


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_limbs_of_wrong_cameras_do_not(small_stages, last, axis):
    two = of_two(last)
    right = limb_variations(small_stages.skeleton, triangulated_with(two, [0.0, 0.0, 0.0]))
    wrong = limb_variations(small_stages.skeleton, triangulated_with(two, 0.2 * np.eye(3)[axis]))
    assert right.max() < 0.04
    assert wrong.min() > 3.0 * right.max()


def scaled(last, factor):
    """The people, larger by a factor for every row."""
    X = last.state.X * np.reshape(factor, (-1, 1, 1))
    return replace(last, state=replace(last.state, X=X))


def test_the_size_of_people_does_not_matter_but_its_change_does(small_stages, last):
    before = limb_variations(small_stages.skeleton, last)
    per_person = np.where(last.observations.person == 0, 0.6, 1.3)
    np.testing.assert_allclose(
        limb_variations(small_stages.skeleton, scaled(last, per_person)), before, rtol=1e-9
    )
    seconds = last.observations.time_bin * last.observations.step_s
    growing = limb_variations(small_stages.skeleton, scaled(last, np.exp(0.2 * seconds)))
    # Medians over 0.4 s of a length that grows by 20 % a second.
    expected = 0.2 * np.sqrt(seconds.max() ** 2 / 12.0)
    np.testing.assert_allclose(growing, expected, rtol=0.25)


def test_sides_are_compared(small_stages, last):
    skeleton = small_stages.skeleton
    X = last.state.X.copy()
    elbow, wrist = (skeleton.layout.index(f"left_{name}") for name in ("elbow", "wrist"))
    X[:, wrist] = X[:, elbow] + 2.0 * (X[:, wrist] - X[:, elbow])
    longer = replace(last, state=replace(last.state, X=X))
    assert limb_variations(skeleton, longer).min() > 0.1


def test_noise_of_single_images_is_subtracted(small_stages, last):
    rng = np.random.default_rng(0)
    noisy = last.state.X + rng.normal(scale=0.04, size=last.state.X.shape)
    found = limb_variations(
        small_stages.skeleton, replace(last, state=replace(last.state, X=noisy))
    )
    # Of forearms of 0.25 m and twelve images it would be 0.07 otherwise.
    assert found.max() < 0.04


def test_too_few_limbs_say_nothing(small_stages, last):
    some = np.zeros_like(last.state.inlier)
    some[:2] = last.state.inlier[:2]
    found = limb_variations(
        small_stages.skeleton, replace(last, state=replace(last.state, inlier=some))
    )
    assert np.isnan(found).all()


def test_a_keypoint_bias_stays_below_the_limit():
    scene = simulate(replace(SMALL, n_frames=150, keypoint_bias_mm=20.0))
    stages = run_stages(scene.recording, HALF_SECOND)
    found = limb_variations(stages.skeleton, stages.iterations[-1])
    assert 0.01 < found.max() < 0.08
