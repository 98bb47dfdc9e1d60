"""Two cameras that share nobody must not be called calibrated."""

from dataclasses import replace

import pytest
from core_helpers import HALF_SECOND, SMALL

from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.synthetic import simulate

FOUR = replace(SMALL, n_cameras=4, n_frames=100)


@pytest.mark.parametrize(
    ("people", "frames", "seed"), [(2, 100, 4), (2, 100, 7), (3, 150, 1), (3, 150, 5), (1, 100, 0)]
)
def test_two_cameras_of_different_places(people, frames, seed):
    options = replace(FOUR, n_people=people, n_frames=frames)
    here, there = (simulate(replace(options, seed=s)) for s in (seed, 100 + seed))
    pair = (here.recording.cameras[0], there.recording.cameras[1])
    calibration = calibrate(replace(here.recording, cameras=pair), HALF_SECOND)
    assert calibration.status is not Status.OK
