"""Forms of keypoint bias: size, what they depend on, and that other random numbers stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import SMALL

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.synthetic import BIAS_FORMS, SceneOptions, simulate
from stcalib_ros.core.synthetic.bias_forms import keypoint_bias
from stcalib_ros.core.synthetic.detector import DetectorBias, displaced
from stcalib_ros.core.synthetic.skeleton import LAYOUT, N_JOINTS

BIAS_MM = 20.0


def placed(joints):
    """Joints whose first is 4 m in front of a camera that stands upright."""
    R_cam_body = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    return joints @ R_cam_body.T + [0.0, 0.0, 4.0]


def upright(**moved):
    """A person who looks away from the camera, with some joints elsewhere (forward, left, up)."""
    joints = np.zeros((1, N_JOINTS, 3))
    places = {
        "left_hip": (0, 0.1, 0),
        "right_hip": (0, -0.1, 0),
        "spine": (0, 0, 0.2),
        "thorax": (0, 0, 0.5),
        "left_shoulder": (0, 0.18, 0.45),
        "right_shoulder": (0, -0.18, 0.45),
    }
    joints[:] = [1e-3, 0.0, 0.0]
    for name, place in {**places, **moved}.items():
        joints[0, LAYOUT.index(name)] = place
    return placed(joints)


def bias(form, seed=0, rms_m=0.02):
    return keypoint_bias(form, np.random.default_rng(seed), np.random.default_rng([seed, 1]), rms_m)


def shift(form, joints_cam, name):
    return (bias(form)(joints_cam) - joints_cam)[0, LAYOUT.index(name)]


@pytest.fixture(scope="module")
def scenes():
    """The same small scene with keypoint biases of every form, without other noise in 2D."""
    options = replace(SMALL, sigma_px=1e-6, keypoint_bias_mm=BIAS_MM)
    plain = simulate(replace(options, keypoint_bias_mm=0.0))
    return plain, {f: simulate(replace(options, keypoint_bias_form=f)) for f in BIAS_FORMS}


@pytest.mark.parametrize("form", BIAS_FORMS)
def test_a_form_is_about_as_large_as_asked_for_and_moves_nothing_else(scenes, form):
    plain, one = scenes[0], scenes[1][form]
    squares = []
    for camera, other in zip(plain.recording.cameras, one.recording.cameras, strict=True):
        np.testing.assert_array_equal(camera.stamps, other.stamps)
        for track, changed in zip(camera.tracks, other.tracks, strict=True):
            np.testing.assert_array_equal(track.joints, changed.joints)
            px = (changed.keypoints - track.keypoints).ravel()
            squares.append(px[np.isfinite(px)] ** 2)
    # People are three to seven metres away.
    focal = plain.recording.cameras[0].intrinsics.K[0, 0]
    rms_mm = 1e3 * np.sqrt(np.mean(np.concatenate(squares))) * 4.5 / focal
    assert BIAS_MM / 2 < rms_mm < BIAS_MM * 2


def test_the_harmonic_form_is_the_polynomial_of_the_direction():
    joints_cam = upright(left_wrist=(0.2, 0.3, 0.1))
    usual = displaced(joints_cam, DetectorBias(np.random.default_rng(0), 0.02))
    np.testing.assert_array_equal(bias("harmonic")(joints_cam), usual)


def test_a_constant_bias_is_the_same_wherever_a_person_stands():
    joints_cam = upright()
    constant = bias("constant")
    moved = constant(joints_cam) - joints_cam
    np.testing.assert_allclose(constant(joints_cam + 1.0) - joints_cam - 1.0, moved, atol=1e-12)
    assert not moved[..., 2].any()
    assert (moved[..., :2] != 0.0).all()


def test_every_view_has_a_constant_bias_of_its_own():
    joints_cam = upright()
    first, again, second = (
        keypoint_bias("views", *(np.random.default_rng(k) for k in (0, 1)), 0.02, camera=c)(
            joints_cam
        )
        for c in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    assert (np.abs(first - second)[..., :2] > 0.0).all()


def test_joints_behind_the_trunk_are_pulled_to_their_side_and_others_stay():
    hidden = upright(left_wrist=(0.2, 0.1, 0.1), right_wrist=(0.2, -0.1, 0.1))
    left, right = (shift("hidden", hidden, f"{side}_wrist") for side in ("left", "right"))
    assert left[0] < -0.01
    assert right[0] > 0.01
    np.testing.assert_allclose([left[1], right[1]], 0.0, atol=1e-3)
    seen = upright(left_wrist=(-0.2, 0.1, 0.1), right_wrist=(0.2, -0.5, 0.1))
    for side in ("left", "right"):
        np.testing.assert_allclose(shift("hidden", seen, f"{side}_wrist"), 0.0, atol=1e-12)


def test_foreshortened_bones_are_displaced_with_the_square_of_the_cosine():
    far = [0.0, 0.0, 1000.0]
    along, across, oblique = (
        shift("foreshortened", upright(left_elbow=(0, 0, 0), left_wrist=at) + far, "left_wrist")
        for at in ((0.3, 0, 0), (0, 0, 0.3), (0.3, 0, 0.3 * np.sqrt(3)))
    )
    assert np.linalg.norm(along) > 0.01
    assert np.linalg.norm(across) < 0.01 * np.linalg.norm(along)
    np.testing.assert_allclose(oblique, 0.25 * along, rtol=0.01)


def test_sizes_differ_by_person_and_have_the_stated_mean_square():
    joints_cam = upright()
    ratio = [
        np.linalg.norm(bias("sizes", seed)(joints_cam) - joints_cam)
        / np.linalg.norm(bias("harmonic", seed)(joints_cam) - joints_cam)
        for seed in range(300)
    ]
    assert max(ratio) > 4 * min(ratio)
    assert np.sqrt(np.mean(np.square(ratio))) == pytest.approx(1.0, abs=0.1)


def test_an_unknown_form_is_refused():
    with pytest.raises(InputError, match=r"keypoint_bias_form: expected one of harmonic, .* 'odd'"):
        SceneOptions(keypoint_bias_form="odd")
