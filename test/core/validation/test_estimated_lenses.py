"""Lenses that were estimated: whether people's motion determined them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stcalib_ros.core.model.lens_knowledge import LensKnowledge, LensPrior
from stcalib_ros.core.model.recording import LensModel, keypoints_only
from stcalib_ros.core.model.rejection import RejectionReason, RemarkCode
from stcalib_ros.core.options import Options
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.core.validation import estimated_lenses
from stcalib_ros.core.validation.estimated_lenses import (
    estimated_lens_faults,
    undetermined_lenses,
)
from stcalib_ros.core.validation.inconsistencies import inconsistencies

UNKNOWN = LensPrior(1400.0, np.inf, (960.0, 540.0), 10.0, (0.0,), 0.2)
GUESSED = replace(UNKNOWN, focal_stddev=0.1)


@pytest.fixture
def said(small_stages):
    """What is said of the second camera, by its focal length and what was and is known of it."""
    last = small_stages.iterations[-1]

    def of(prior, *, stddev=0.005, focal_px=1400.0, model=LensModel.PLUMB_BOB):
        camera = small_stages.lifted[1]
        K = np.array([[focal_px, 0.0, 960.0], [0.0, focal_px, 540.0], [0.0, 0.0, 1.0]])
        lens = replace(camera.intrinsics, K=K, model=model)
        changed = replace(camera, intrinsics=lens, lens_prior=prior)
        lifted = (small_stages.lifted[0], changed, *small_stages.lifted[2:])
        known = np.zeros((5, len(lifted)))
        known[0, 1] = stddev
        found = estimated_lens_faults(lifted, replace(last, lens_stddev=known))
        assert found[0] is found[2] is None
        return found[1]

    return of


def test_a_focal_length_that_is_determined_is_good(said):
    assert said(UNKNOWN) is None
    assert said(GUESSED) is None


def test_an_unknown_focal_length_that_is_not_determined_is_refused(said):
    found = said(UNKNOWN, stddev=0.12)
    assert found.reason is RejectionReason.LENS_UNDETERMINED
    assert (found.measured, found.limit) == (0.12, 0.01)
    assert said(UNKNOWN, stddev=np.inf).reason is RejectionReason.LENS_UNDETERMINED


def test_a_guess_that_nothing_refines_is_held(small_stages):
    last = small_stages.iterations[-1]
    first, *rest = small_stages.lifted
    guessed = (replace(first, lens_prior=GUESSED), *rest)
    known = np.zeros((5, len(guessed)))
    known[0, 0] = 0.015
    assert undetermined_lenses(guessed, replace(last, lens_stddev=known)) == [0]
    known[0, 0] = 0.005
    assert undetermined_lenses(guessed, replace(last, lens_stddev=known)) == []
    unknown = (replace(first, lens_prior=UNKNOWN), *rest)
    assert undetermined_lenses(unknown, replace(last, lens_stddev=10 * known)) == []
    held = (replace(first, lens_knowledge=LensKnowledge.REFINE), *rest)
    found = estimated_lens_faults(held, last)
    assert found[0].code is RemarkCode.LENS_HELD
    assert found[1:] == (None, None)


def test_lenses_say_nothing_where_cameras_see_people_from_one_direction(
    said, small_stages, monkeypatch
):
    monkeypatch.setattr(estimated_lenses, "depth_variance_ratio", lambda *_: 144.0)
    found = said(UNKNOWN)
    assert found.reason is RejectionReason.LENS_NEEDS_PARALLAX
    assert found.measured == 12.0
    assert said(GUESSED) is None
    lifted = [replace(camera, lens_prior=GUESSED) for camera in small_stages.lifted]
    last = replace(small_stages.iterations[-1], lens_stddev=np.full((5, 3), 0.001))
    assert undetermined_lenses(lifted, last) == [0, 1, 2]


@pytest.mark.parametrize(("focal_px", "limit"), [(300.0, 145.0), (6000.0, 20.0)])
@pytest.mark.parametrize("prior", [UNKNOWN, GUESSED])
def test_a_view_that_no_lens_has_is_refused(said, prior, focal_px, limit):
    found = said(prior, focal_px=focal_px)
    assert found.reason is RejectionReason.LENS_IMPLAUSIBLE
    assert found.limit == limit


def test_a_wide_lens_and_a_fisheye_are_usual(said):
    assert said(UNKNOWN, focal_px=500.0) is None
    assert said(UNKNOWN, focal_px=600.0, model=LensModel.EQUIDISTANT) is None


def test_an_estimate_far_from_its_guess_is_worth_a_remark(said):
    found = said(GUESSED, focal_px=2000.0)
    assert found.code is RemarkCode.LENS_FAR_FROM_GIVEN
    assert found.values["times"] == pytest.approx(2000.0 / 1400.0)
    assert found.values["deviations"] == pytest.approx(10.0 * np.log(2000.0 / 1400.0))


def test_nothing_is_said_of_given_lenses(small_stages):
    last = small_stages.iterations[-1]
    assert estimated_lens_faults(small_stages.lifted, last) == (None, None, None)
    found = inconsistencies(small_stages.lifted, small_stages.skeleton, last)
    assert [one.rejections for one in found] == [(), (), ()]


def test_guesses_for_two_cameras_are_held_and_nothing_gets_worse():
    scene = simulate(SceneOptions(n_cameras=2, n_people=2, n_frames=120, seed=3))
    recording = keypoints_only(scene.recording)
    options = Options(offset_range_s=0.5, intrinsics="refine")
    found = calibrate(recording, options)
    held = [one.cameras for one in found.remarks if one.code is RemarkCode.LENS_HELD]
    assert held == [("cam0",), ("cam1",)]
    given = calibrate(recording, replace(options, intrinsics="given"))
    for one, other in zip(found.cameras, given.cameras, strict=True):
        assert np.array_equal(one.intrinsics.K, other.intrinsics.K)
        assert one.R_ref_cam == pytest.approx(other.R_ref_cam, abs=2e-3)
