"""Which change explains what is seen: closed forms on scenes without errors."""

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import EXACT
from hypothesis import given
from hypothesis import strategies as st
from outdated_calibrations import TURN, ZERO, in_units, outdated

from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.recording import excerpt
from stcalib_ros.core.monitoring.change_detection import (
    CLOCK,
    ROTATION,
    SHIFT,
    _PointPairs,
    detect_changes,
)
from stcalib_ros.core.monitoring.matching import associate_span
from stcalib_ros.core.synthetic import simulate


def explained(recording, calibration):
    found = associate_span(recording, calibration, min_score=0.3)
    n = len(found.names)
    return dict(zip(found.names, detect_changes(found, np.full((n, n), 3.0)), strict=True))


@pytest.fixture(scope="module")
def scene():
    return simulate(replace(EXACT, seed=3))


CHANGES = {
    "turn": {"turn": TURN},
    "shift": {"shift": (0.05, -0.03, 0.1)},
    "clock": {"clock_s": 0.06},
    "turn and clock": {"turn": TURN, "clock_s": -0.05},
}


@pytest.mark.parametrize("name", ["cam0", "cam2"])
@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_change_is_found_with_its_size_and_nobody_else_is_blamed(scene, name, change):
    found = explained(scene.recording, outdated(scene.truth, name, **change))
    fit = found[name].fit
    assert fit.gain > 3.0
    assert fit.after_px < 0.5 * fit.before_px
    np.testing.assert_allclose(fit.change[ROTATION], change.get("turn", ZERO), atol=0.004)
    np.testing.assert_allclose(fit.change[SHIFT], change.get("shift", ZERO), atol=0.02)
    assert fit.change[CLOCK] == pytest.approx(-change.get("clock_s", 0.0), abs=0.015)
    for other, finding in found.items():
        assert other == name or finding.fit.gain < 0.3
        assert finding.rivals == ()


def test_nothing_is_found_where_nothing_has_happened(scene):
    for finding in explained(scene.recording, scene.truth).values():
        assert finding.fit.gain < 0.01
        assert finding.fit.before_px < 0.5
        assert finding.matched == finding.expected == finding.n_steps
        assert finding.missed == 0


def test_the_unit_of_length_does_not_matter(scene):
    old = outdated(scene.truth, "cam1", turn=TURN, shift=(0.0, 0.2, 0.0))
    metric = explained(scene.recording, old)["cam1"].fit
    other = explained(scene.recording, in_units(old, 4.7))["cam1"].fit
    np.testing.assert_allclose(other.change, metric.change, atol=0.01)


def test_two_cameras_that_have_both_moved_are_both_found():
    scene = simulate(replace(EXACT, n_cameras=5, seed=4))
    old = outdated(scene.truth, "cam1", turn=TURN)
    old = outdated(old, "cam3", turn=(-TURN[1], TURN[0], 0.0))
    found = explained(scene.recording, old)
    for name, turn in (("cam1", TURN), ("cam3", (-TURN[1], TURN[0], 0.0))):
        np.testing.assert_allclose(found[name].fit.change[ROTATION], turn, atol=0.008)
    assert all(found[n].fit.gain < 1.0 for n in ("cam0", "cam2", "cam4"))


def test_of_two_cameras_it_cannot_be_determined_which():
    scene = simulate(replace(EXACT, n_cameras=2, seed=5))
    found = explained(scene.recording, outdated(scene.truth, "cam1", turn=TURN))
    assert (found["cam0"].rivals, found["cam1"].rivals) == (("cam1",), ("cam0",))
    assert min(f.fit.gain for f in found.values()) > 1.0


def test_a_camera_that_is_turned_far_matches_nobody(scene):
    found = explained(
        scene.recording, outdated(scene.truth, "cam1", turn=(0.0, np.radians(20.0), 0.0))
    )
    assert found["cam1"].expected >= 5
    assert found["cam1"].matched == 0
    assert all(found[n].matched == found[n].expected for n in ("cam0", "cam2", "cam3"))


def test_a_camera_without_people_should_have_seen_them(scene):
    cameras = tuple(
        replace(c, tracks=()) if c.name == "cam3" else c for c in scene.recording.cameras
    )
    found = explained(replace(scene.recording, cameras=cameras), scene.truth)
    assert found["cam3"].missed == found["cam3"].n_steps
    assert found["cam3"].fit.n_points == found["cam3"].expected == 0
    assert found["cam0"].matched == found["cam0"].expected > 0


def test_too_few_cameras_with_images_say_nothing(scene):
    empty = excerpt(scene.recording, 100.0, 102.0)
    assert associate_span(empty, scene.truth, min_score=0.3) is None


@given(
    seed=st.integers(0, 10**6),
    change=st.lists(st.floats(-0.05, 0.05), min_size=7, max_size=7).map(np.array),
)
def test_derivatives_are_those_of_the_residuals(seed, change):
    rng = np.random.default_rng(seed)
    x, y = (
        np.concatenate([rng.uniform(-0.5, 0.5, (6, 2)), np.ones((6, 1))], axis=1) for _ in range(2)
    )
    R = exp_so3(rng.standard_normal(3))
    v = np.concatenate([rng.standard_normal((6, 2)), np.zeros((6, 1))], axis=1)
    t = np.tile(rng.standard_normal(3) + np.array([3.0, 0.0, 0.0]), (6, 1))
    points = _PointPairs(
        x=x,
        v=v,
        y=y @ R.T,
        t=t,
        R=np.tile(R, (6, 1, 1)),
        focal=rng.uniform(500, 1500, 6),
        noise=np.ones(6),
        n=6,
        other=np.ones(6, dtype=np.int64),
        n_cameras=2,
    )
    r, J = points.residuals(np.zeros(7))
    # The scale of the Sampson distance is held in the derivative: exact where the residual is 0.
    points = replace(points, x=x - r[:, None] * _toward_zero(points, r))
    r, J = points.residuals(np.zeros(7))
    np.testing.assert_allclose(r, 0.0, atol=1e-6)
    step = 1e-6 * change
    moved, _ = points.residuals(step)
    np.testing.assert_allclose(moved - r, J @ step, atol=1e-6 + 1e-3 * np.abs(J @ step).max())


def _toward_zero(points, r):
    """Displacement of x per px of residual that brings the point onto its epipolar line."""
    n = np.cross(points.t, points.y)
    n[:, 2] = 0.0
    algebraic = (points.x * np.cross(points.t, points.y)).sum(-1)
    return n * (algebraic / (n**2).sum(-1) / np.where(r == 0, 1.0, r))[:, None]
