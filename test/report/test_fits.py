"""One count of keypoints, from which every share of a report is."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from stcalib_ros.core.capture.evidence import CaptureEvidence
from stcalib_ros.report.content import ReportContent, content_of_result
from stcalib_ros.report.fits import camera_fits

NAMES = ["cam0", "cam1", "cam2"]


def test_cameras_add_up_to_the_calibration(report_content: ReportContent) -> None:
    fits, c = camera_fits(report_content.evidence, NAMES), report_content.calibration
    assert [fit.name for fit in fits] == NAMES
    assert sum(fit.n_seen for fit in fits) == c.n_observations
    assert sum(fit.n_fit for fit in fits) == c.n_inliers
    together = np.concatenate([fit.errors[fit.fits] for fit in fits])
    assert np.sqrt((together**2).mean()) == pytest.approx(c.reprojection_rms_px, rel=1e-4)
    assert all(0.5 < fit.share <= 1.0 for fit in fits)


def test_pixels_are_those_of_the_recording(report_content: ReportContent) -> None:
    (first, *_) = camera_fits(report_content.evidence, NAMES)
    camera = report_content.recording.cameras[0]
    seen = np.concatenate([track.keypoints.reshape(-1, 2) for track in camera.tracks])
    distance = np.linalg.norm(seen[:, None] - first.pixels[:50], axis=-1)
    assert np.nanmin(distance, axis=0).max() < 0.1


def test_people_are_as_tall_as_their_keypoints_reach(report_content: ReportContent) -> None:
    (first, *_) = camera_fits(report_content.evidence, NAMES)
    tracks = report_content.recording.cameras[0].tracks
    tall = np.concatenate([np.ptp(t.keypoints, axis=1) for t in tracks])
    assert first.person_px == pytest.approx(np.nanmedian(np.linalg.norm(tall, axis=-1)), rel=0.15)


def test_cameras_without_evidence_are_left_out(report_content: ReportContent) -> None:
    assert camera_fits(None, NAMES) == ()
    assert [f.name for f in camera_fits(report_content.evidence, ["cam9", "cam1"])] == ["cam1"]


def test_a_finished_result_fits_nearly_as_well(report_content: ReportContent) -> None:
    again = content_of_result(report_content.recording, report_content.calibration)
    assert isinstance(again.evidence, CaptureEvidence)
    mine, theirs = (camera_fits(one.evidence, NAMES) for one in (again, report_content))
    for a, b in zip(mine, theirs, strict=True):
        assert a.n_seen == pytest.approx(b.n_seen, rel=0.02)
        assert a.share == pytest.approx(b.share, abs=0.05)


def test_people_of_a_finished_result_have_the_numbers_of_its_persons(
    report_content: ReportContent,
) -> None:
    c = report_content.calibration
    turned = tuple(
        dataclasses.replace(person, person_id=7 - person.person_id) for person in c.persons
    )
    other = dataclasses.replace(c, persons=turned)
    people = content_of_result(report_content.recording, other).people
    assert [p.person_id for p in people] == [7, 6]
    strangers = dataclasses.replace(c, persons=())
    people = content_of_result(report_content.recording, strangers).people
    assert [p.person_id for p in people] == [0, 1]
