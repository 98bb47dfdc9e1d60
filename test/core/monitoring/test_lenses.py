"""What arrives is seen through the lenses of the calibration in force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import EXACT

from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.recording import unknown_intrinsics
from stcalib_ros.core.monitoring.change_detection import ROTATION
from stcalib_ros.core.monitoring.lenses import with_lenses_in_force
from stcalib_ros.core.monitoring.spans import check_span
from stcalib_ros.core.synthetic import simulate


@pytest.fixture(scope="module")
def scene():
    return simulate(EXACT)


def without_lens(recording, *names):
    return replace(
        recording,
        cameras=tuple(
            replace(c, intrinsics=unknown_intrinsics(c.intrinsics.width, c.intrinsics.height))
            if c.name in names
            else c
            for c in recording.cameras
        ),
    )


def estimated(truth, *names):
    return replace(
        truth,
        cameras=tuple(
            replace(c, lens_knowledge=LensKnowledge.UNKNOWN) if c.name in names else c
            for c in truth.cameras
        ),
    )


def test_estimated_lenses_are_used_where_the_driver_has_none(scene):
    blind = without_lens(scene.recording, "cam1", "cam2")
    span = check_span(
        blind, estimated(scene.truth, "cam1", "cam2"), start_s=0.0, end_s=2.0, min_score=0.3
    )
    assert set(span.findings) == {c.name for c in scene.recording.cameras}
    for name in ("cam1", "cam2"):
        np.testing.assert_allclose(span.findings[name].fit.change[ROTATION], 0.0, atol=1e-3)


def test_they_take_precedence_over_what_a_driver_says_and_given_ones_do_not(scene):
    first = scene.recording.cameras[0]
    wrong = replace(first.intrinsics, K=first.intrinsics.K * [[1.3], [1.3], [1.0]])
    recording = replace(
        scene.recording,
        cameras=(replace(first, intrinsics=wrong), *scene.recording.cameras[1:]),
    )
    seen = with_lenses_in_force(recording, estimated(scene.truth, "cam0"))
    assert seen.cameras[0].intrinsics is scene.truth.cameras[0].intrinsics
    assert with_lenses_in_force(recording, scene.truth).cameras[0].intrinsics is wrong


def test_a_camera_without_a_lens_or_with_images_of_another_size_is_left_out(scene):
    blind = without_lens(scene.recording, "cam1")
    others = replace(scene.truth, cameras=tuple(c for c in scene.truth.cameras if c.name != "cam1"))
    names = [c.name for c in with_lenses_in_force(blind, others).cameras]
    assert names == ["cam0", "cam2", "cam3"]
    small = replace(blind.cameras[1], intrinsics=unknown_intrinsics(320, 240))
    resized = replace(blind, cameras=(small,))
    assert with_lenses_in_force(resized, scene.truth).cameras == ()
    span = check_span(resized, scene.truth, start_s=0.0, end_s=2.0, min_score=0.3)
    assert span.findings == {}
