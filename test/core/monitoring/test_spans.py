"""A span held to a calibration, and once more with what was found."""

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import EXACT, error
from outdated_calibrations import TURN, in_units, outdated

from stcalib_ros.core.monitoring.change_detection import CLOCK, ROTATION, SHIFT
from stcalib_ros.core.monitoring.spans import check_span, with_changes
from stcalib_ros.core.synthetic import simulate


@pytest.fixture(scope="module")
def scene():
    return simulate(EXACT)


def fit_of(scene, calibration, name):
    span = check_span(scene.recording, calibration, start_s=0.0, end_s=2.0, min_score=0.3)
    return span.findings[name].fit


@pytest.mark.parametrize("jump_s", [-0.15, 0.1])
def test_a_jump_is_measured_to_milliseconds(scene, jump_s):
    fit = fit_of(scene, outdated(scene.truth, "cam1", clock_s=jump_s), "cam1")
    assert fit.change[CLOCK] == pytest.approx(-jump_s, abs=0.004)
    assert fit.after_px < 0.2 * fit.before_px


@pytest.mark.parametrize("degrees", [5.0, 10.0])
def test_large_turns_are_measured(scene, degrees):
    turn = np.radians([0.6 * degrees, 0.0, 0.8 * degrees])
    fit = fit_of(scene, outdated(scene.truth, "cam2", turn=turn), "cam2")
    np.testing.assert_allclose(fit.change[ROTATION], turn, atol=0.002)


@pytest.mark.parametrize("unit_m", [1.0, 3.3])
def test_the_change_that_is_found_mends_the_calibration(scene, unit_m):
    old = outdated(scene.truth, "cam3", turn=TURN, shift=(0.0, 0.1, 0.05), clock_s=0.07)
    old = in_units(old, unit_m)
    change = fit_of(scene, old, "cam3").change
    new = with_changes(old, {"cam3": change}, unit_m)
    before, after = error(old, scene.truth), error(new, scene.truth)
    assert after.E_R < 0.3 * before.E_R
    assert after.E_delta < 0.3 * before.E_delta
    np.testing.assert_array_equal(new.cameras[1].R_ref_cam, old.cameras[1].R_ref_cam)


def test_nothing_is_refined_where_nothing_has_happened(scene):
    fit = fit_of(scene, scene.truth, "cam1")
    np.testing.assert_allclose(fit.change, 0.0, atol=1e-3)
    assert not fit.change[SHIFT].any()


def test_a_rolling_shutter_that_the_calibration_knows_is_no_jump():
    rolling = simulate(replace(EXACT, line_time_s=(0.0, 25e-6, 0.0, 0.0)))
    known, unknown = (
        fit_of(rolling, truth, "cam1").change[CLOCK]
        for truth in (rolling.truth, without_line_times(rolling.truth))
    )
    assert known == pytest.approx(0.0, abs=4e-3)
    assert abs(unknown) > 8e-3


def without_line_times(truth):
    return replace(truth, cameras=tuple(replace(c, line_time_s=0.0) for c in truth.cameras))
