"""Results in words."""

from __future__ import annotations

from dataclasses import replace

import pytest

import stcalib_ros as st
from stcalib_ros.wording import clock_text

CAMERA = st.simulate(st.SceneOptions(n_cameras=2, n_frames=30)).truth.cameras[1]


@pytest.mark.parametrize(
    ("offset_s", "said"),
    [
        (0.29782, "+297.82 ms +- 0.26"),
        (-99.0, "-99000.00 ms +- 0.26"),
        (1759900000.297504, "+1759900000.29750 s +- 0.00026"),
    ],
)
def test_a_time_offset(offset_s: float, said: str) -> None:
    camera = replace(CAMERA, time_offset_s=offset_s, time_offset_stddev_s=2.6e-4, clock_skew=0.0)
    assert clock_text(camera, "cam0") == said
