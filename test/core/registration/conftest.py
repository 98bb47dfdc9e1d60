"""A scene by which pairs of cameras are registered."""

from __future__ import annotations

from dataclasses import replace

import pytest
from core_helpers import EXACT, lifted
from epipolar_helpers import true_pair

from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.synthetic import simulate


@pytest.fixture(scope="package")
def subframe() -> tuple[tuple[LiftedCamera, ...], RelativePose]:
    """Exact keypoints, clocks off by fractions of a frame, poses off by their usual errors.

    And the truth of a pair.
    """
    poses = {"lifter_mm": (45, 45), "tilt_deg": 3, "crop_perspective": 1}
    scene = simulate(replace(EXACT, max_offset_frames=4, seed=3, **poses))
    return lifted(scene.recording)[1], true_pair(scene, 0, 1)
