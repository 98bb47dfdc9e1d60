"""What the normal equations of a solved rig say of its lenses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stcalib_ros.core.bundle.levenberg_marquardt import adjust
from stcalib_ros.core.validation.lens_hypotheses import (
    LENS,
    Hypothesis,
    LensSystem,
    lens_trial,
)

ALL = np.ones(3, dtype=bool)
NONE = Hypothesis(~ALL)
FOCAL = LENS.index("focal")


@pytest.fixture(scope="module")
def given(small_stages):
    return [camera.intrinsics for camera in small_stages.lifted]


def scaled(last, factors):
    """A round adjusted to keypoints of lenses of other focal lengths."""
    obs = last.observations
    x = (obs.x * np.array(factors)[:, None, None]).astype(obs.x.dtype)
    changed = replace(obs, x=x)
    return last.with_state(changed, adjust(changed, last.state, iterations=20, tolerance=0.3))


def test_of_right_lenses_nothing_is_significant(small_stages, given):
    trial = lens_trial(small_stages.iterations[-1], given, ALL)
    assert LensSystem(trial).best(NONE).significance < 5.0
    assert np.array_equal(trial.corrections(), np.zeros((3, len(LENS))))


def test_the_camera_of_another_lens_is_the_most_significant(small_stages, given):
    last = scaled(small_stages.iterations[-1], (1.0, 1.1, 1.0))
    trial = lens_trial(last, given, ALL)
    found = LensSystem(trial).best(NONE)
    assert found.cameras.tolist() == [False, True, False]
    assert not found.common
    fit = trial.fitted(found)
    stddev = LensSystem(fit).stddev(found)
    assert fit.corrections()[1, FOCAL] == pytest.approx(np.log(1.1), abs=0.02)
    assert 0.0 < stddev[1, FOCAL] < 0.02
    assert np.array_equal(stddev[0], np.zeros(len(LENS)))
    assert LensSystem(fit).best(found).significance < 0.5 * found.significance


def test_one_ratio_of_all_focal_lengths_explains_more_than_any_camera(small_stages, given):
    last = scaled(small_stages.iterations[-1], (0.9, 0.9, 0.9))
    trial = lens_trial(last, given, ALL)
    found = LensSystem(trial).best(NONE)
    assert found.common
    focal = trial.fitted(found).corrections()[:, FOCAL]
    assert focal == pytest.approx(np.full(3, np.log(0.9)), abs=0.02)
    assert np.ptp(focal) < 1e-9


def test_cameras_that_are_not_tested_keep_their_lens(small_stages, given):
    last = scaled(small_stages.iterations[-1], (1.0, 1.1, 1.0))
    trial = lens_trial(last, given, np.array([True, False, False]))
    found = LensSystem(trial).best(NONE)
    assert found.cameras.tolist() == [True, False, False]
    assert np.array_equal(trial.fitted(found).corrections()[1:], np.zeros((2, len(LENS))))
