"""Keypoints that are not those of the lens of their CameraInfo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stcalib_ros.core.bundle.levenberg_marquardt import adjust
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.recording import keypoints_only
from stcalib_ros.core.model.rejection import RejectionReason, RemarkCode
from stcalib_ros.core.model.rejection_text import sentence
from stcalib_ros.core.options import Options
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.core.validation import lens_hypotheses
from stcalib_ros.core.validation.lens_checks import lens_faults

K = np.array([1400.0, 1400.0])
MIDDLE = np.array([960.0, 540.0])


@pytest.fixture(scope="module")
def stages():
    scene = simulate(SceneOptions(n_frames=150, seed=21))
    return run_stages(keypoints_only(scene.recording), Options(offset_range_s=0.5))


@pytest.fixture(autouse=True)
def _few_keypoints(monkeypatch):
    monkeypatch.setattr(lens_hypotheses, "_KEYPOINTS", 4_000)


def faults(stages, change, cameras):
    """Faults after the adjustment has made up for another lens as well as it can."""
    last = stages.iterations[-1]
    obs, x = last.observations, last.observations.x.copy()
    for c in cameras:
        x[:, c] = (change(K * x[:, c] + MIDDLE) - MIDDLE) / K
    obs = replace(obs, x=x)
    state = adjust(obs, last.state, iterations=30, tolerance=0.3)
    found = lens_faults(stages.lifted, last.with_state(obs, state))
    return {c: why for c, why in enumerate(found) if why is not None}


def test_lenses_that_are_right_have_no_fault(stages):
    assert faults(stages, lambda x: x, []) == {}


@pytest.mark.parametrize("camera", [0, 2])
def test_keypoints_of_a_resized_and_padded_image_are_those_of_one_camera(stages, camera):
    found = faults(stages, lambda x: 0.6 * x + [0.0, 210.0], [camera])
    assert list(found) == [camera]
    assert found[camera].reason is RejectionReason.IMAGE_RESIZED
    values = found[camera].values
    assert values["scale_x"] == pytest.approx(0.6, abs=0.1)
    assert values["scale_y"] == pytest.approx(values["scale_x"], abs=0.05)
    assert values["corner_y"] == pytest.approx(210, abs=90)
    assert abs(found[camera].measured) > found[camera].limit
    assert "times as wide" in sentence(found[camera])


def test_images_of_all_cameras_are_resized(stages):
    assert len(faults(stages, lambda x: 0.75 * x, range(4))) >= 2


@pytest.mark.parametrize("camera", [0, 1])
def test_a_focal_length_that_is_a_little_off_is_worth_a_remark(stages, camera):
    found = faults(stages, lambda x: MIDDLE + (x - MIDDLE) / 1.05, [camera])
    assert list(found) == [camera]
    assert found[camera].code is RemarkCode.LENS_DEVIATES
    assert found[camera].values == {"scale": pytest.approx(1 / 1.05, abs=0.01)}


def test_all_focal_lengths_are_off_by_one_ratio(stages):
    found = faults(stages, lambda x: MIDDLE + (x - MIDDLE) * 1.05, range(4))
    assert list(found) == [0, 1, 2, 3]
    scales = [one.values["scale"] for one in found.values()]
    assert scales == [pytest.approx(1.05, abs=0.01)] * 4
    assert len(set(scales)) == 1


def test_a_principal_point_that_is_a_little_off_is_worth_a_remark(stages):
    values = faults(stages, lambda x: x + np.array([50.0, 0.0]), [2])[2].values
    assert values["cx"] - values["given_cx"] == pytest.approx(50.0, abs=15.0)


def test_the_principal_point_of_an_image_turned_by_half(stages):
    off = np.array([230.0, -130.0])
    moved = stages.lifted[1].intrinsics.K.copy()
    moved[:2, 2] += off
    lens = replace(stages.lifted[1].intrinsics, K=moved)
    lifted = (stages.lifted[0], replace(stages.lifted[1], intrinsics=lens), *stages.lifted[2:])
    found = faults(replace(stages, lifted=lifted), lambda x: x - off, [1])
    assert found[1].reason is RejectionReason.IMAGE_TURNED


def test_pixels_that_are_not_square_show(stages):
    found = faults(stages, lambda x: MIDDLE + (x - MIDDLE) * [1.1, 1 / 1.1], [3])
    assert list(found) == [3]
    values = found[3].values
    assert values["scale_x"] / values["scale_y"] == pytest.approx(1.21, abs=0.03)


def test_lenses_that_are_estimated_are_not_judged_as_given_ones(stages):
    lifted = tuple(replace(one, lens_knowledge=LensKnowledge.REFINE) for one in stages.lifted)
    assert faults(replace(stages, lifted=lifted), lambda x: 0.75 * x, [1]) == {}


def test_a_crop_shows_in_the_principal_point(stages):
    found = faults(stages, lambda x: x - [480.0, 270.0], [1])
    assert list(found) == [1]
    assert found[1].values["corner_x"] < -200
    assert found[1].values["scale_x"] == pytest.approx(1.0, abs=0.1)


def test_exchanged_coordinates_of_the_principal_point_look_like_a_turn(stages):
    found = faults(stages, lambda x: x + MIDDLE[::-1] - MIDDLE, [3])
    assert list(found) == [3]
    assert found[3].reason is RejectionReason.IMAGE_TURNED


def test_distortion_that_is_left_out_is_named(stages):
    def bent(x):
        u = (x - MIDDLE) / K
        return MIDDLE + K * u * (1 - 0.9 * (u**2).sum(-1, keepdims=True))

    found = faults(stages, bent, [1])
    assert list(found) == [1]
    assert found[1].reason is RejectionReason.DISTORTION_DISAGREES
    assert found[1].measured < -found[1].limit


def test_two_cameras_alone_do_not_tell(stages):
    last = stages.iterations[-1]
    used = last.state.inlier & (np.arange(4) < 2)[:, None]
    alone = replace(last, state=last.state.with_inliers(used))
    assert lens_faults(stages.lifted, alone) == (None,) * 4
