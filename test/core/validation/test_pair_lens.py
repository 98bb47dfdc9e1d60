"""Two cameras, of which one or both have keypoints of another image size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stcalib_ros.core.bundle.levenberg_marquardt import adjust
from stcalib_ros.core.model.recording import keypoints_only
from stcalib_ros.core.model.rejection import RejectionReason
from stcalib_ros.core.options import Options
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.core.validation.pair_lens import pair_lens_faults

MIDDLE = np.array([960.0, 540.0]) / 1400.0


@pytest.fixture(scope="module")
def stages():
    scene = simulate(SceneOptions(n_cameras=2, n_frames=300, seed=31))
    return run_stages(keypoints_only(scene.recording), Options(offset_range_s=0.5))


def faults(stages, cameras, factor):
    """Faults after the adjustment has made up for another size as well as it can."""
    last = stages.iterations[-1]
    x = last.observations.x.copy()
    for c in cameras:
        x[:, c] = factor * (x[:, c] + MIDDLE) - MIDDLE
    obs = replace(last.observations, x=x)
    state = adjust(obs, last.state, iterations=30, tolerance=0.3)
    found = pair_lens_faults(stages.lifted, stages.skeleton, last.with_state(obs, state))
    return {c: why for c, why in enumerate(found) if why is not None}


def test_lenses_that_are_right_have_no_fault(stages):
    assert faults(stages, [], 1.0) == {}


@pytest.mark.parametrize(("cameras", "factor"), [([0], 0.5), ([1], 2 / 3), ([0, 1], 0.75)])
def test_cameras_with_images_of_another_size_are_named(stages, cameras, factor):
    found = faults(stages, cameras, factor)
    assert list(found) == cameras
    for why in found.values():
        assert why.reason is RejectionReason.IMAGE_RESIZED
        assert why.values["scale_x"] == pytest.approx(factor, abs=0.1)
        assert why.measured > why.limit


def test_nothing_is_said_of_three_cameras(small_stages):
    last = small_stages.iterations[-1]
    found = pair_lens_faults(small_stages.lifted, small_stages.skeleton, last)
    assert found == (None, None, None)
