"""What residual is usual: of the watch's own spans, whatever a calibration reports."""

from __future__ import annotations

import numpy as np
import pytest

from stcalib_ros.core.geometry.robust import MIN_NOISE_PX
from stcalib_ros.core.monitoring.limits import FIRST_NOISE_PX, MAX_NOISE_PX, NOISE_SPANS
from stcalib_ros.core.monitoring.noise import Noise

NAMES = ("left", "middle", "right")


def spans(*values_px, names=NAMES):
    """Noise after spans in which the first two cameras have these residuals."""
    noise = Noise()
    for px in values_px:
        measured = np.full((len(names), len(names)), np.nan)
        measured[0, 1] = measured[1, 0] = px
        noise = noise.after(names, measured)
    return noise


def test_before_anything_was_seen_it_is_that_of_usual_detectors():
    np.testing.assert_array_equal(Noise().px(NAMES), np.full((3, 3), FIRST_NOISE_PX))


def test_it_is_the_median_of_the_spans_and_of_two_cameras():
    found = spans(7.0, 8.0, 8.5, 15.0).px(NAMES)
    assert found[0, 1] == found[1, 0] == 8.0
    assert found[0, 2] == 8.0, "what is not known is that of the others"


def test_the_names_count_and_not_their_order():
    found = spans(9.0, 9.0, names=("right", "left")).px(("left", "right"))
    assert found[0, 1] == found[1, 0] == 9.0


def test_it_follows_other_detectors_and_forgets_the_old_ones():
    found = spans(*[4.0] * NOISE_SPANS, *[11.0] * NOISE_SPANS)
    assert found.px(NAMES)[0, 1] == 11.0
    assert len(found.recent_px["left", "middle"]) == NOISE_SPANS


@pytest.mark.parametrize("px", [MAX_NOISE_PX + 0.1, 70.0, np.inf])
def test_what_no_change_explains_never_comes_to_be_usual(px):
    found = spans(5.0, 5.0, *[px] * 40).px(NAMES)
    assert found[0, 1] == 5.0


def test_it_is_never_less_than_that_of_good_detectors():
    assert spans(*[0.1] * 9).px(NAMES)[0, 1] == MIN_NOISE_PX


def test_spans_without_people_leave_it_as_it_is():
    noise = spans(8.0, 9.0)
    assert noise.after(NAMES, np.full((3, 3), np.nan)) == noise
