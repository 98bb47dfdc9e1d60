"""Which camera is known least, what would help it, and clock rates that are left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import HALF_SECOND, SMALL, SOUND

from stcalib_ros.core.bundle.iteration import ClockSkews
from stcalib_ros.core.model.rejection import RemarkCode
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.synthetic import simulate
from stcalib_ros.core.validation.recommendations import (
    recommend,
    shared_s,
    unobservable_clock_skews,
    without_poses,
)

NAMES = ["cam0", "cam1", "cam2"]


@pytest.fixture(scope="module")
def last(small_stages):
    return small_stages.iterations[-1]


def said(last, **changes):
    """Remarks on three cameras, the last one changed."""
    return recommend(NAMES, [SOUND, SOUND, replace(SOUND, **changes)], last)


@pytest.mark.parametrize(
    ("changes", "value"),
    [
        ({"rotation_stddev": 0.002}, {"rotation_stddev_deg": np.degrees(0.002)}),
        ({"position_stddev": 0.05}, {"position_stddev_percent": 5.0}),
        ({"offset_stddev_frames": 0.5}, {"offset_stddev_ms": 1e3 * 0.5 / 30}),
    ],
)
def test_the_least_constrained_camera_is_named_with_its_standard_deviations(last, changes, value):
    remark, _ = said(last, **changes)
    assert remark.code is RemarkCode.LEAST_CONSTRAINED_CAMERA
    assert remark.cameras == ("cam2",)
    assert {**remark.values, **value} == pytest.approx(remark.values)


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"offset_stddev_frames": 0.5}, RemarkCode.MOVE_FASTER),
        ({"rotation_stddev": 0.002}, RemarkCode.RECORD_LONGER),
        ({"rotation_stddev": 0.01, "shared_s": 2.0}, RemarkCode.SHARE_MORE_VIEW),
    ],
)
def test_advice_fits_the_weakness(last, changes, code):
    assert said(last, **changes)[1].code is code


def test_little_in_common_wants_people_where_the_views_overlap(last):
    _, advice = said(last, rotation_stddev=0.01, shared_s=2.0)
    common = shared_s(last)[2]
    partner = int(np.argmin(common[:2]))
    assert advice.cameras == ("cam2", f"cam{partner}")
    assert advice.values == {"shared_s": 2.0, "usual_s": 8.0, "common_s": common[partner]}


def test_the_advice_of_a_longer_clip_holds():
    """Deviations of a clip of twice the length, against what is promised."""
    short, long = (
        run_stages(simulate(replace(SMALL, n_frames=n, seed=5)).recording, HALF_SECOND)
        for n in (80, 160)
    )
    assert RemarkCode.RECORD_LONGER in [r.code for r in short.calibration.remarks]
    before, after = (
        np.sqrt([np.trace(c.covariance[3:, 3:]) for c in stages.calibration.cameras[1:]]).max()
        for stages in (short, long)
    )
    assert after == pytest.approx(0.7 * before, rel=0.35)


def test_known_clocks_have_no_standard_deviation(last):
    known = replace(last, rig=replace(last.rig, synchronised=True))
    assert "offset_stddev_ms" not in said(known, rotation_stddev=0.01)[0].values


def test_shared_time_is_that_of_common_knots(last):
    time = shared_s(last)
    np.testing.assert_allclose(time, time.T)
    # Two people, seen by three cameras for 80 frames.
    assert time.max() <= 2 * 81 / 30
    assert time[0, 1] > 4.0


# Clock rates


def rates(last, ppm, skew=0.0):
    stddev = np.array([0.0, *1e-6 * np.array(ppm)])
    return replace(last, clock_skews=ClockSkews(np.array([0.0, skew, 0.0]), stddev, 0.0))


def test_why_clock_skews_are_not_estimated_is_said_with_the_number(last):
    length_s = np.ptp(last.observations.time_bin) * last.observations.step_s
    (remark,) = unobservable_clock_skews(rates(last, (40.0, 80.0)))
    assert remark.code is RemarkCode.CLOCK_SKEW_NOT_OBSERVABLE
    assert remark.values == pytest.approx(
        {"length_s": length_s, "stddev_ppm": 80.0, "limit_ppm": 10.0, "enough_s": 4 * length_s}
    )


def test_of_a_clip_without_any_information_only_its_length_is_said(last):
    (remark,) = unobservable_clock_skews(rates(last, (np.inf, 80.0)))
    assert set(remark.values) == {"length_s"}


def test_skews_that_are_observable_or_not_asked_for_need_no_remark(last):
    assert unobservable_clock_skews(rates(last, (5.0, 5.0), skew=2e-6))
    observable = replace(last, clock_skews=ClockSkews(np.full(3, 2e-6), np.full(3, 4e-6), 0.0))
    assert unobservable_clock_skews(observable) == ()
    assert unobservable_clock_skews(replace(last, clock_skews=None)) == ()


def test_a_short_clip_says_it_in_its_remarks(small_stages):
    calibration = small_stages.calibration
    (remark,) = [r for r in calibration.remarks if r.code is RemarkCode.CLOCK_SKEW_NOT_OBSERVABLE]
    worst = max(c.clock_skew_stddev for c in calibration.cameras)
    assert remark.values["stddev_ppm"] == pytest.approx(1e6 * worst)


def test_cameras_without_poses_are_named():
    bare = replace(SOUND, bone_rotation=float("nan"), limb_variation=0.034)
    assert without_poses(NAMES, [SOUND] * 3) == ()
    (remark,) = without_poses(NAMES, [SOUND, bare, replace(bare, limb_variation=0.01)])
    assert remark.code is RemarkCode.VERIFIED_BY_LIMBS_ALONE
    assert remark.cameras == ("cam1", "cam2")
    assert remark.values == {"limb_variation_percent": pytest.approx(3.4)}
