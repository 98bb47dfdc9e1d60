"""Every stage against the truth, for both methods."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import FPS, FRAME_S, HALF_SECOND
from scipy.stats import norm

from benchmarks.paper.windows import register_on_windows
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.evaluation.metrics import geometric_precision, triangulation_errors
from stcalib_ros.core.evaluation.stage_errors import judge_pair, judge_stages
from stcalib_ros.core.lifting.views import lift_views
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.options import Options, RegistrationOptions, VmfOptions
from stcalib_ros.core.paper.registration import PairRegistration
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.synthetic import SceneOptions, paper_scene


@pytest.fixture(scope="module")
def true_pair(noisy):
    """Two cameras registered without any error."""
    views = lift_views(noisy.recording, Options())
    o = Options(registration=RegistrationOptions(method="vmf"), vmf=VmfOptions(window=5))
    rng = np.random.default_rng(0)
    starts = range(10, 80, 5)
    found = register_on_windows(views, 0, 1, starts, o, max_lag=8, rng=rng)
    a, b = noisy.truth.cameras[:2]
    h = replace(
        found.hypothesis,
        R_a_b=a.R_ref_cam.T @ b.R_ref_cam,
        t_a_b=a.R_ref_cam.T @ (b.t_ref_cam - a.t_ref_cam),
        lag_s=a.time_offset_s - b.time_offset_s,
    )
    return views.lifted, replace(found, hypothesis=h)


def test_the_truth_has_the_errors_that_noise_alone_makes(true_pair, noisy):
    cameras, found = true_pair
    errors = judge_pair(cameras, found, noisy.truth, window=5, fps=FPS)
    assert pytest.approx(0, abs=1e-6) == errors.E_R
    assert errors.E_t == pytest.approx(0, abs=1e-9)
    assert errors.E_delta == pytest.approx(0, abs=1e-9)
    assert errors.precision == 1.0
    assert errors.n_matches == len(found.matches)
    assert pytest.approx(3 / np.sqrt(np.pi), rel=0.05) == errors.E_2D
    assert errors.E_2D_rms == pytest.approx(3 / np.sqrt(2), rel=0.05)
    assert errors.P_5px == pytest.approx(2 * norm.cdf(5 * np.sqrt(2) / 3) - 1, abs=0.01)


def test_errors_of_a_pair_are_those_that_were_put_in(true_pair, noisy):
    cameras, found = true_pair
    h = found.hypothesis
    exchanged = [(w, p, (1, 0, 2)[q]) for w, p, q in found.matches]
    wrong = PairRegistration(
        replace(h, t_a_b=-h.t_a_b, lag_s=h.lag_s + 2 * FRAME_S),
        found.starts,
        np.array(exchanged),
        found.cost_rad,
    )
    errors = judge_pair(cameras, wrong, noisy.truth, window=5, fps=FPS)
    assert errors.E_t == pytest.approx(2.0)
    assert errors.E_delta == pytest.approx(2.0)
    right = sum(p == q for _, p, q in exchanged) / len(exchanged)
    assert errors.precision == pytest.approx(right)
    assert errors.P_5px < 0.7


def test_triangulated_points_without_noise_have_no_error(rng):
    R = np.stack([np.eye(3), [[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]])
    t = np.array([[0.0, 0, 0], [4.0, 0, 4.0]])
    X = rng.uniform([-1, -1, 3], [1, 1, 5], (50, 3))
    Y = np.einsum("cij,mci->mcj", R, X[:, None] - t)
    x, focal = Y[..., :2] / Y[..., 2:], np.full((50, 2), 1000.0)
    seen = np.ones((50, 2), dtype=bool)
    assert triangulation_errors(R, t, x, focal, seen) == pytest.approx(0.0, abs=1e-6)
    assert geometric_precision(R, t, x, focal, seen) == 1.0
    x[:20, 1, 1] += 0.05
    assert geometric_precision(R, t, x, focal, seen) == pytest.approx(0.6)
    seen[:, 1] = False
    assert np.isnan(triangulation_errors(R, t, x, focal, seen)).all()
    assert np.isnan(geometric_precision(R, t, x, focal, seen))


def test_the_papers_stages_get_better_one_by_one(noisy, noisy_stages):
    assert noisy_stages.calibration.status is Status.OK
    rows = judge_stages(noisy_stages, noisy.truth, fps=FPS)
    assert list(rows) == ["PR", "MI", "STBA", "ISTBA"]
    assert rows["PR"].E_R < 0.03
    assert rows["STBA"].E_R < 0.3 * rows["MI"].E_R
    assert rows["ISTBA"].E_R < 2e-3
    assert rows["ISTBA"].E_t < 2e-3
    assert rows["ISTBA"].E_delta < 0.05
    for row in rows.values():
        assert row.precision == 1.0
        assert row.missing == 0
    assert rows["PR"].P_5px == pytest.approx(0.975, abs=0.02)


def test_the_default_has_the_same_rows(small_scene, small_stages):
    rows = judge_stages(small_stages, small_scene.truth, fps=FPS)
    assert list(rows) == ["PR", "MI", "STBA", "ISTBA"]
    last = small_stages.iterations[-1]
    assert rows["ISTBA"].E_2D_rms == pytest.approx(small_stages.calibration.reprojection_rms_px)
    assert rows["ISTBA"].E_R < rows["PR"].E_R
    assert len(last.rig.cameras) == 3


@pytest.mark.parametrize("method", ["vmf", "correlation"])
def test_synchronised_cameras_have_ba_rows_and_no_offsets(method):
    scene = paper_scene(
        SceneOptions(n_cameras=3, n_people=3, n_frames=60, seed=6), offset_frames=0.0
    )
    o = Options(offset_range_s=0.0, registration=RegistrationOptions(method=method))
    stages = run_stages(scene.recording, o)
    assert stages.calibration.status is Status.OK
    assert [c.time_offset_s for c in stages.calibration.cameras] == [0.0] * 3
    assert [c.time_offset_stddev_s for c in stages.calibration.cameras] == [0.0] * 3
    assert {h.lag_s for h in stages.hypotheses} == {0.0}
    rows = judge_stages(stages, scene.truth, fps=FPS, synchronised=True)
    assert list(rows) == ["PR", "MI", "BA", "IBA"]
    assert rows["IBA"].E_R < 2e-3
    assert rows["IBA"].E_delta == 0.0


def test_a_truth_that_lacks_a_camera_is_refused(true_pair, noisy):
    cameras, found = true_pair
    truth = replace(noisy.truth, cameras=noisy.truth.cameras[:1])
    with pytest.raises(InputError, match="the truth lacks camera 'cam1'"):
        judge_pair(cameras, found, truth, window=5, fps=FPS)


def test_offsets_are_left_to_the_adjustment_if_that_is_wanted(noisy):
    recording = paper_scene(
        SceneOptions(n_cameras=3, n_people=3, n_frames=90, seed=4), offset_frames=1.0
    ).recording
    o = replace(
        HALF_SECOND,
        registration=RegistrationOptions(method="vmf"),
        vmf=VmfOptions(window=9, search_offsets=False, initial="candidates"),
    )
    stages = run_stages(recording, o)
    assert {h.lag_s for h in stages.hypotheses} == {0.0}
    assert stages.iterations[-1].rig.offset_s[1:] == pytest.approx(FRAME_S, abs=0.1 * FRAME_S)
