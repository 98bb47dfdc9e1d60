"""Errors of single stamps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import SMALL

from stcalib_ros.core.bundle.levenberg_marquardt import PointProblem, time_sums
from stcalib_ros.core.bundle.parameters import TIME_OFFSET
from stcalib_ros.core.bundle.residuals import noise_px
from stcalib_ros.core.geometry.robust import CAUCHY
from stcalib_ros.core.options import BundleOptions
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.refinement import timestamp_jitter as image_times
from stcalib_ros.core.refinement.timestamp_jitter import added_covariance, with_timestamp_errors
from stcalib_ros.core.synthetic import simulate

JITTER_S = 0.005


@pytest.fixture(scope="module")
def shaky():
    """Scene and stages with stamps that are off by 5 ms."""
    scene = simulate(replace(SMALL, stamp_jitter_s=JITTER_S, seed=5))
    return scene, run_stages(scene.recording)


def corrections_and_truth(scene, stages):
    """What was added to the stamps of images, and what should have been; per camera."""
    last = stages.iterations[-1]
    o = last.observations
    out = []
    for i, c in enumerate(last.rig.cameras):
        rows = np.flatnonzero(o.track[:, i] >= 0)
        offset = last.rig.offset_s[i] - last.state.shift_s[i]
        when = o.start_s + o.time_bin[rows] * o.step_s + o.phi[rows, i] - offset
        stamps = scene.recording.cameras[c].stamps
        frame = np.abs(stamps - when[:, None]).argmin(1)
        off = scene.exposures_s[c] - stamps
        trend = np.polyval(np.polyfit(stamps, off, 1), stamps)
        out.append((when - stamps[frame], (off - trend)[frame]))
    return out


def test_errors_of_stamps_are_found(shaky):
    for added, true in corrections_and_truth(*shaky):
        assert true.std() > 0.8 * JITTER_S
        assert (added - true).std() < 0.2 * JITTER_S


def test_without_even_times_they_are_told_by_what_images_show(shaky):
    scene, _ = shaky
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(image_times, "regular_times", np.zeros_like)
        stages = run_stages(scene.recording)
    # What all cameras' images of a moment have in common moves the joints along, and is not told.
    for added, true in corrections_and_truth(scene, stages):
        assert np.corrcoef(added, true)[0, 1] > 0.6
        assert (added - true).std() < 0.85 * JITTER_S


def test_their_size_is_told(shaky):
    _, stages = shaky
    found = stages.iterations[-1].timestamp_errors
    np.testing.assert_allclose(found.stddev_s, JITTER_S, rtol=0.2)
    n = stages.iterations[-1].observations.time_bin.max() + 1
    assert (found.offset_variance > 0.5 * JITTER_S**2 / n).all()


def test_offsets_are_no_better_known_than_the_mean_of_the_stamps(shaky):
    scene, stages = shaky
    last, found = stages.iterations[-1], stages.calibration
    layout = last.state.layout
    added = np.diag(added_covariance(last.timestamp_errors, layout))
    least = np.sqrt(added[layout.scalars(TIME_OFFSET)[1:]])
    for true, camera, low in zip(scene.truth.cameras[1:], found.cameras[1:], least, strict=True):
        assert camera.time_offset_stddev_s > low > 0.0
        error = abs(camera.time_offset_s - true.time_offset_s)
        assert error < 4.0 * camera.time_offset_stddev_s


def test_without_errors_nothing_changes(small_stages):
    last = small_stages.iterations[-1]
    assert last.timestamp_errors is None
    assert with_timestamp_errors(small_stages.lifted, last, BundleOptions()) is last
    assert not added_covariance(last.timestamp_errors, last.state.layout).any()


def test_sums_over_all_images_are_those_of_the_offsets(small_stages):
    last = small_stages.iterations[-1]
    group = np.zeros(len(last.observations.time_bin), dtype=np.int64)
    H, g = time_sums(last.observations, last.state, group)
    sigma = noise_px(last.observations, last.state)
    problem = PointProblem(last.observations, last.state, CAUCHY * sigma)
    system, offset = problem.reduce(0.0).system, problem.layout.scalars(TIME_OFFSET)
    expected = system.H[np.ix_(offset, offset)] / sigma**2
    np.testing.assert_allclose(H[0], expected, rtol=1e-6, atol=1e-6 * H.max())
    np.testing.assert_allclose(g[0], system.g[offset] / sigma**2, rtol=1e-6, atol=1e-6 * H.max())


def test_the_gain_is_that_of_a_gaussian(rng):
    H = np.diag([4e6, 9e6])[None].repeat(400, 0)
    noise = rng.standard_normal((400, 2)) / np.sqrt([4e6, 9e6])
    true = 0.004 * rng.standard_normal((400, 2))
    g = -np.einsum("kcd,kd->kc", H, true + noise)
    none = np.zeros_like(g)
    found = image_times._posterior(H, g, none, none)
    total = (true + noise).var(0)
    per_image = -np.log(total * [4e6, 9e6]) + (total * [4e6, 9e6]) - 1.0
    assert found.gain == pytest.approx(200 * per_image.sum(), rel=0.02)
    known = image_times._posterior(H, g, none, true)
    assert known.gain > found.gain
    np.testing.assert_allclose(known.correction_s, true, atol=5e-4)
