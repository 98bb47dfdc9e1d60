"""What the numbers of a calibration mean."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest

from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.model.rejection import RemarkCode
from stcalib_ros.core.options import Options
from stcalib_ros.report.clocks import CameraClock, camera_clocks
from stcalib_ros.report.content import ReportContent, content_of_result
from stcalib_ros.report.fits import KeypointFit, camera_fits
from stcalib_ros.report.grade import Grade, disagreeing, grade

NAMES = ["cam0", "cam1", "cam2"]


@pytest.fixture(scope="module")
def fits(report_content: ReportContent) -> tuple[KeypointFit, ...]:
    return camera_fits(report_content.evidence, NAMES)


@pytest.fixture(scope="module")
def clocks(report_content: ReportContent) -> tuple[CameraClock, ...]:
    return camera_clocks(report_content.evidence, NAMES, "cam0", Options())


def weak(found: Grade) -> list[str]:
    return [one.text for one in found.findings if not one.good]


def with_changes(content: ReportContent, **changes: object) -> ReportContent:
    calibration = dataclasses.replace(content.calibration, **changes)
    return dataclasses.replace(content, calibration=calibration)


def test_a_sound_calibration_is_as_good_as_it_can_be(
    report_content: ReportContent, fits: Sequence[KeypointFit], clocks: Sequence[CameraClock]
) -> None:
    found = grade(report_content, fits, clocks)
    assert found.good
    assert weak(found) == []
    assert len(found.findings) == 6


def test_pixels_are_judged_by_the_size_of_people(
    report_content: ReportContent, fits: Sequence[KeypointFit]
) -> None:
    small = [dataclasses.replace(fit, person_px=20.0) for fit in fits]
    (text,) = weak(grade(report_content, small, ()))
    rms = report_content.calibration.reprojection_rms_px
    assert f"{rms:.1f} px (rms): {rms / 20.0:.1%} of the height of a person" in text
    unknown = [dataclasses.replace(fit, person_px=float("nan")) for fit in fits]
    assert weak(grade(report_content, unknown, ())) == []


def test_one_camera_that_is_worse_is_named(
    report_content: ReportContent, fits: Sequence[KeypointFit]
) -> None:
    bad = dataclasses.replace(fits[1], median_px=5.0 * fits[1].median_px)
    (text,) = weak(grade(report_content, [fits[0], bad, fits[2]], ()))
    assert "cam1 (" in text
    few = dataclasses.replace(fits[2], n_fit=fits[2].n_seen // 2)
    (text,) = weak(grade(report_content, [*fits[:2], few], ()))
    assert "cam2 (" in text
    assert "50% fit" in text


@pytest.mark.parametrize(
    "values",
    [
        {"rotation_stddev_deg": 0.6},
        {"position_stddev_percent": 6.0},
        {"offset_stddev_ms": 20.0},
    ],
)
def test_an_uncertain_camera_is_named(
    report_content: ReportContent, fits: Sequence[KeypointFit], values: dict[str, float]
) -> None:
    least, *others = report_content.calibration.remarks
    assert least.code is RemarkCode.LEAST_CONSTRAINED_CAMERA
    loose = dataclasses.replace(least, values=least.values | values)
    content = with_changes(report_content, remarks=(loose, *others))
    (text,) = weak(grade(content, fits, ()))
    assert text.startswith("The least certain camera is cam")
    assert "near the limit" in text


def test_doubtful_clocks_and_people_are_named(
    report_content: ReportContent, fits: Sequence[KeypointFit], clocks: Sequence[CameraClock]
) -> None:
    error = np.linspace(1.5, 1.2, len(clocks[0].error))
    near = dataclasses.replace(clocks[0], error=error, runner_up=3)
    people = [dataclasses.replace(p, margin=1.1) for p in report_content.calibration.persons]
    content = with_changes(report_content, persons=tuple(people))
    clock, who = weak(grade(content, fits, [near, clocks[1]]))
    assert "of cam1" in clock
    assert "1.1 times" in who


def test_the_valley_of_an_offset_is_at_the_offset(clocks: Sequence[CameraClock]) -> None:
    assert [clock.name for clock in clocks] == ["cam1", "cam2"]
    for clock in clocks:
        assert clock.difference_s[np.nanargmin(clock.error)] == 0.0
        assert np.nanmin(clock.error) == pytest.approx(1.0)
        assert np.all(np.diff(clock.difference_s) > 0)
        assert np.abs(clock.change_s).max() < 0.02


def test_a_recording_after_a_camera_was_moved(report_content: ReportContent) -> None:
    *others, last = report_content.calibration.cameras
    turned = dataclasses.replace(last, R_ref_cam=last.R_ref_cam @ exp_so3(np.array([0, 0.1, 0])))
    calibration = dataclasses.replace(report_content.calibration, cameras=(*others, turned))
    content = content_of_result(report_content.recording, calibration)
    found = grade(content, camera_fits(content.evidence, NAMES), ())
    assert not found.good
    assert "not agree with the result" in found.title


def test_one_camera_that_does_not_agree(
    report_content: ReportContent, fits: Sequence[KeypointFit]
) -> None:
    off = dataclasses.replace(fits[2], n_fit=fits[2].n_seen // 3)
    content = dataclasses.replace(report_content, from_result=True)
    assert disagreeing([*fits[:2], off]) == ("cam2",)
    found = grade(content, [*fits[:2], off], ())
    assert found.title == "cam2 does not agree with the result"


def test_another_recording(report_content: ReportContent, fits: Sequence[KeypointFit]) -> None:
    none = [dataclasses.replace(fit, n_fit=fit.n_seen // 10) for fit in fits]
    content = dataclasses.replace(report_content, from_result=True)
    found = grade(content, none, ())
    assert found.title == "This recording does not agree with the result"
    assert "calibrate again" in found.meaning


@pytest.mark.parametrize("status", [one for one in Status if one is not Status.OK])
def test_what_is_refused_has_no_grade(status: Status, report_content: ReportContent) -> None:
    found = grade(with_changes(report_content, status=status), (), ())
    assert not found.good
    assert found.findings == ()
