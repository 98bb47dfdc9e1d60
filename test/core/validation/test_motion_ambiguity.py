"""Steps that repeat, people who move alike, one line: named where they are, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import HALF_SECOND, SMALL

from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.model.rejection import RejectionReason
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.synthetic import SceneOptions, scene, simulate
from stcalib_ros.core.validation.motion_ambiguity import Ambiguity, find_ambiguity, is_collinear

PERIOD_S = 0.8


def ambiguity_of(stages):
    return find_ambiguity(stages.lifted, stages.skeleton, stages.iterations[-1])


def rejections_of(calibration, reason):
    return [r for r in calibration.rejections if r.reason is reason]


def made_of(monkeypatch, change):
    """People changed on the way into the simulated scene."""
    real = scene.make_people
    monkeypatch.setattr(scene, "make_people", lambda *args: change(real(*args)))


def repeating(person):
    """Somebody who does the same things again and again, forth and back, at one place."""

    def joints(times):
        phase = np.cos(2 * np.pi * times / PERIOD_S)
        return person(0.4 * (1.0 + phase))

    return joints


def test_usual_people_leave_nothing_open(small_stages):
    found = ambiguity_of(small_stages)
    assert found == Ambiguity()
    assert found.rejections() == ()


def test_motion_that_repeats_itself_is_named_with_its_period(monkeypatch):
    made_of(monkeypatch, lambda people: tuple(repeating(person) for person in people))
    stages = run_stages(simulate(replace(SMALL, n_people=1, n_frames=120)).recording, HALF_SECOND)
    calibration = stages.calibration
    assert calibration.status is Status.DEGENERATE
    assert ambiguity_of(stages).periods_s == pytest.approx((PERIOD_S,), abs=0.04)
    periodic = rejections_of(calibration, RejectionReason.PERIODIC_MOTION)
    assert periodic[0].values["longest_s"] == pytest.approx(PERIOD_S, abs=0.04)
    assert not ambiguity_of(stages).identical


def test_one_who_does_not_repeat_himself_is_enough(monkeypatch):
    made_of(monkeypatch, lambda people: (repeating(people[0]), *people[1:]))
    stages = run_stages(simulate(replace(SMALL, n_frames=120)).recording, HALF_SECOND)
    assert stages.calibration.status is Status.OK
    assert ambiguity_of(stages).periods_s == ()


def test_people_who_move_alike_are_named(monkeypatch):
    def identical(people):
        one = people[0]
        shifts = [np.array([1.2 * k, 0.4 * k, 0.0]) for k in range(3)]
        return (one, *((lambda times, s=s: one(times) + s) for s in shifts[1:]))

    made_of(monkeypatch, identical)
    recording = simulate(SceneOptions(n_people=3, n_frames=60, seed=1)).recording
    stages = run_stages(recording, HALF_SECOND)
    identical = rejections_of(stages.calibration, RejectionReason.IDENTICAL_MOTION)
    assert {"person_a": 0.0, "person_b": 1.0} in [r.values for r in identical]
    people = {person.person_id for person in stages.calibration.persons}
    assert {p for pair in ambiguity_of(stages).identical for p in pair} <= people


def test_people_on_one_line_are_noticed(small_stages):
    standing = SceneOptions(n_people=2, people="gesturing", n_frames=120, seed=6001)
    stages = run_stages(simulate(standing).recording, HALF_SECOND)
    assert is_collinear(stages.iterations[-1])
    assert not is_collinear(small_stages.iterations[-1])
    found = ambiguity_of(stages).rejections()
    assert RejectionReason.COLLINEAR_MOTION in [r.reason for r in found]
