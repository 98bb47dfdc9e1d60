"""The last stage: keypoints that lean one way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import SMALL

from stcalib_ros.core.bundle.covariance import pose_covariance
from stcalib_ros.core.evaluation.metrics import evaluate
from stcalib_ros.core.options import BundleOptions
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.refinement.keypoint_bias.harmonics import trunk_of
from stcalib_ros.core.refinement.keypoint_bias.solver import Problem
from stcalib_ros.core.refinement.keypoint_bias.stage import _corrected, refine_keypoint_bias
from stcalib_ros.core.refinement.sequence import refine
from stcalib_ros.core.synthetic import detector, simulate


def other_bias(self, direction):
    """Smooth, but neither a polynomial nor free of a constant part."""
    along = np.einsum("jab,tb->tja", self._linear, direction) / 0.02
    return 0.025 * np.tanh(
        along + np.einsum("jabc,tb,tc->tja", self._square, *[direction] * 2) / 0.02
    )


@pytest.fixture(scope="module", params=["polynomial", "other"])
def leaning(request):
    """Scene and stages with keypoints that are off by 20 mm."""
    options = replace(SMALL, keypoint_bias_mm=20.0, seed=7)
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "other":
            patch.setattr(detector.DetectorBias, "__call__", other_bias)
        scene = simulate(options)
    return scene, run_stages(scene.recording)


def test_biases_are_found_and_taken_out(leaning):
    scene, stages = leaning
    before, after = stages.iterations[-2:]
    assert after.median_px < 0.7 * before.median_px
    errors = evaluate(stages.calibration, scene.truth, fps=30.0)
    plain = error_of(stages, before, scene)
    assert errors.E_R < 0.6 * plain.E_R
    assert errors.E_t < 0.8 * plain.E_t


def error_of(stages, one, scene):
    """What the result would be with the poses of another round."""
    cameras = tuple(
        replace(c, R_ref_cam=R, t_ref_cam=stages.placement.unit * t)
        for c, R, t in zip(
            stages.calibration.cameras, one.rig.R_ref_cam, one.rig.t_ref_cam, strict=True
        )
    )
    return evaluate(replace(stages.calibration, cameras=cameras), scene.truth, fps=30.0)


def test_without_biases_nothing_changes(small_stages):
    last = small_stages.iterations[-1]
    layout = small_stages.skeleton.layout
    assert refine_keypoint_bias(small_stages.lifted, last, layout, BundleOptions()) is None


def test_people_of_whom_the_fit_has_no_row_keep_their_keypoints(leaning):
    _, stages = leaning
    last, trunk = stages.iterations[-2], trunk_of(stages.skeleton.layout)
    fit, _ = Problem(last.observations, last.state, trunk).solve()
    persons = np.unique(last.observations.person)
    every = _corrected(last, fit, persons, trunk).x
    some = _corrected(last, replace(fit, bias=fit.bias[1:]), persons[1:], trunk).x
    first = last.observations.person == persons[0]
    np.testing.assert_array_equal(some[first], last.observations.x[first])
    np.testing.assert_array_equal(some[~first], every[~first])
    assert not np.array_equal(every[first], some[first], equal_nan=True)


def test_unknown_biases_are_part_of_the_covariance(leaning):
    _, stages = leaning
    last = stages.iterations[-1]
    known = np.diag(pose_covariance(last.observations, last.state))
    unit = stages.placement.unit
    scale = np.tile([unit] * 3 + [1.0] * 4, len(last.rig.cameras))
    found = np.sqrt(np.diag(stages.calibration.joint_covariance)) / scale
    assert (found >= np.sqrt(known) - 1e-12).all()
    assert (found[7:] > 1.2 * np.sqrt(known)[7:]).any()


def test_the_joint_covariance_knows_biases_by_name(leaning):
    _, stages = leaning
    layout = stages.skeleton.layout
    refined = refine(stages.lifted, stages.iterations[:-1], layout, BundleOptions())
    joint, name = refined.covariance, f"person0.{layout.joint_names[4]}.keypoint_bias"
    assert len(refined.iterations) == len(stages.iterations)
    assert {"cam1.rotation", "cam2.time_offset", name} <= set(joint.names)
    assert (joint.stddev(name) > 0.0).all()
    P = joint.block("cam1.translation", "cam2.time_offset", name)
    assert np.linalg.eigvalsh(P / np.sqrt(np.outer(np.diag(P), np.diag(P))))[0] > -1e-9
    np.testing.assert_allclose(joint.covariance("cam1.translation", name), P[:3, 4:], rtol=1e-9)
    assert joint.covariance("cam1.translation", name).any()
    assert not joint.stddev("cam0.rotation").any()
    with pytest.raises(KeyError, match="cam7"):
        joint.stddev("cam7.rotation")


@pytest.mark.parametrize("seed", range(4))
def test_people_of_any_length_do_not_end_it(leaning, seed):
    """Passers-by, and people in pieces: the thinned rows need not have anybody."""
    _, stages = leaning
    last, rng = stages.iterations[-2], np.random.default_rng(seed)
    obs = last.observations
    keep = rng.random(len(obs.person)) < 0.9
    pieces = obs.person.copy()
    for person in np.unique(obs.person):
        rows = np.flatnonzero(obs.person == person)
        cuts = np.sort(rng.choice(len(rows), size=rng.integers(1, 8)))
        pieces[rows] = 100 * person + np.searchsorted(cuts, np.arange(len(rows)), side="right")
    for piece in rng.permutation(np.unique(pieces))[::3]:
        rows = np.flatnonzero(pieces == piece)
        keep[rows[rng.integers(0, 3) :]] = False
    rows = np.flatnonzero(keep)
    cut = replace(
        last, observations=replace(obs, person=pieces).only(rows), state=last.state.only(rows)
    )
    found = refine_keypoint_bias(stages.lifted, cut, stages.skeleton.layout, BundleOptions())
    assert found is not None
    assert set(found.persons) <= set(pieces[rows])
    assert len(found.fit.bias) == len(found.persons)
    assert found.round.median_px < 1.1 * last.median_px
