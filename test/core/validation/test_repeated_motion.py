"""Time offsets that are wrong by a repetition of the motion, with the camera moved as far."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import SMALL

from stcalib_ros.core.bundle.covariance import pose_covariance
from stcalib_ros.core.model.rejection import RejectionReason
from stcalib_ros.core.options import Options
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.synthetic import scene, simulate
from stcalib_ros.core.validation.camera_checks import check_cameras, rejection
from stcalib_ros.core.validation.repeated_motion import repetition_ratios

PERIOD_S = 0.8
STEP = np.array([0.4, 0.1, 0.0])


def striding(person):
    """Somebody who repeats a movement of the whole body, a step further on every time."""

    def joints(times):
        phase = np.cos(2 * np.pi * times / PERIOD_S)
        return person(0.4 * (1.0 + phase)) + times[:, None, None] / PERIOD_S * STEP

    return joints


def stages_of(monkeypatch, change):
    """Stages with known clocks of a scene whose people are changed."""
    real = scene.make_people
    monkeypatch.setattr(scene, "make_people", lambda *args: change(real(*args)))
    options = replace(SMALL, n_people=2, n_frames=120, max_offset_frames=0.0)
    return run_stages(simulate(options).recording, Options(offset_range_s=0.0))


def test_a_motion_that_repeats_itself_elsewhere_is_a_rival(monkeypatch):
    stages = stages_of(monkeypatch, lambda people: tuple(map(striding, people)))
    last = stages.iterations[-1]
    ratio, distance_s = repetition_ratios(stages.lifted, last, max_shift=45)
    np.testing.assert_allclose(ratio, 1.0, atol=0.2)
    np.testing.assert_allclose(distance_s, PERIOD_S, atol=0.02)
    free = replace(last, rig=replace(last.rig, synchronised=False))
    covariance = pose_covariance(last.observations, last.state)
    checks = check_cameras(stages.lifted, stages.skeleton, free, covariance, offset_range_s=1.0)
    for one in checks[1:]:
        found = rejection(one)
        assert found is not None
        assert found.reason is RejectionReason.OFFSET_AMBIGUOUS
        assert found.values["alternative_s"] == pytest.approx(PERIOD_S, abs=0.02)


def test_one_who_does_not_repeat_themselves_decides(monkeypatch):
    stages = stages_of(monkeypatch, lambda people: (striding(people[0]), *people[1:]))
    ratio, _ = repetition_ratios(stages.lifted, stages.iterations[-1], max_shift=45)
    assert ratio.min() > 1.5


def test_shorter_ranges_than_the_period_have_no_rival(monkeypatch):
    stages = stages_of(monkeypatch, lambda people: tuple(map(striding, people)))
    ratio, distance_s = repetition_ratios(stages.lifted, stages.iterations[-1], max_shift=20)
    assert ratio.min() > 1.5
    assert distance_s.max() < 0.7


def test_usual_motion_has_no_rival(small_stages):
    ratio, _ = repetition_ratios(small_stages.lifted, small_stages.iterations[-1], max_shift=30)
    assert ratio.min() > 1.5
