"""Images and their gaps, on the common clock."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from stcalib_ros.report.content import ReportContent
from stcalib_ros.report.timeline import image_times, timeline


def test_images_are_on_the_common_clock(report_content: ReportContent) -> None:
    rows = image_times(report_content)
    for row, own in zip(rows, report_content.calibration.cameras, strict=True):
        later = row.times_s - row.camera.stamps
        assert later == pytest.approx(np.full(len(later), own.time_offset_s), abs=1e-4)
        assert row.gaps == ()


def test_gaps_are_found_and_said(report_content: ReportContent) -> None:
    first, *others = report_content.recording.cameras
    kept = np.ones(len(first.stamps), dtype=bool)
    kept[40:70] = False
    cut = dataclasses.replace(first, stamps=first.stamps[kept], tracks=())
    recording = dataclasses.replace(report_content.recording, cameras=(cut, *others))
    content = dataclasses.replace(report_content, recording=recording)
    (gap,) = image_times(content)[0].gaps
    assert gap == pytest.approx((first.stamps[39], first.stamps[70]))
    html = timeline(content)
    assert html.count('class="gap"') == 1
    assert f"1 gap of up to {gap[1] - gap[0]:.2f} s" in html


def test_cameras_without_images_or_pose(report_content: ReportContent) -> None:
    first, second, _ = report_content.recording.cameras
    dead = dataclasses.replace(first, stamps=np.zeros(0), tracks=())
    other = dataclasses.replace(second, name="cam9")
    recording = dataclasses.replace(report_content.recording, cameras=(dead, other))
    html = timeline(dataclasses.replace(report_content, recording=recording))
    assert "0 images" in html
    assert "(by its own clock)" in html
    recording = dataclasses.replace(report_content.recording, cameras=(dead,))
    assert timeline(dataclasses.replace(report_content, recording=recording)) == ""
