"""The report: one file, escaped, in plain words, of refused calibrations as well."""

from __future__ import annotations

import dataclasses
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from exclusion_helpers import left_out

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.model.recording import Recording, keypoints_only
from stcalib_ros.core.model.rejection import Rejection, RejectionReason
from stcalib_ros.core.options import BundleOptions, Options
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.synthetic import Scene
from stcalib_ros.report.content import ReportContent, content_of_stages
from stcalib_ros.report.html import report_html, write_report
from stcalib_ros.report.tables import sightings

_VOID = {"meta", "input"}


class Page(HTMLParser):
    """Text of a page, and the pictures and tags in it."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.sources: list[str] = []
        self.text = ""
        self.feed(html)
        assert self.open == []

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.sources += [v or "" for k, v in attrs if k in ("src", "href")]
        if tag not in _VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not {"style", "script"} & set(self.open):
            self.text += data


def html_of(content: ReportContent, **changes: object) -> str:
    """Report of the same recording with another calibration."""
    calibration = dataclasses.replace(content.calibration, **changes)
    return report_html(dataclasses.replace(content, calibration=calibration))


@pytest.fixture(scope="module")
def page(report_content: ReportContent) -> Page:
    return Page(report_html(report_content))


def test_it_needs_no_other_file(page: Page, report_content: ReportContent) -> None:
    assert page.sources == []
    assert page.tags.count("script") == 3
    assert not {"link", "iframe", "img"} & set(page.tags)
    assert "default-src 'none'" in report_html(report_content)


def test_it_says_what_was_found(page: Page, report_content: ReportContent) -> None:
    calibration = report_content.calibration
    assert page.text.strip().startswith("Calibration\n")
    for said in (
        "Calibrated, as precisely as the pose estimator allows",
        "3 of 3 cameras placed by 2 people, and their clocks set to that of cam0.",
        "The least certain camera is cam",
        "LEAST_CONSTRAINED_CAMERA",
        f"{calibration.n_inliers} of the {calibration.n_observations} of people whom two cameras",
        f"Keypoints miss by {calibration.reprojection_rms_px:.1f} px (rms)",
        "T_ref_cam: x_ref = R x_cam + t",
        "t_ref = t_cam + offset",
        "Lengths are in metres",
        f"{1e3 * calibration.cameras[1].time_offset_s:+.2f} ms ± ",
        "cam0, cam1",
        "30.0 images a second",
        "h36m_17",
        "All options have their defaults.",
    ):
        assert said in page.text
    assert "nan" not in page.text.lower().split()


def test_parts_are_in_the_order_of_what_is_asked_first(page: Page) -> None:
    titles = [
        "Calibrated, as precisely as the pose estimator allows",
        "Cameras and people in 3D",
        "Images and people over time",
        "Clocks",
        "Who is who",
        "Residuals",
        "What is weak, and what to do next",
        "Options and versions",
    ]
    places = [page.text.index(f"{title}\n") for title in titles]
    assert places == sorted(places)


def test_options_that_were_set_are_listed(report_content: ReportContent) -> None:
    options = Options(offset_range_s=1.0, bundle=BundleOptions(outlier_factor=4.0))
    text = Page(report_html(dataclasses.replace(report_content, options=options))).text
    assert "offset_range_s1.0" in text.replace("\n", "")
    assert "bundle.outlier_factor4.0" in text.replace("\n", "")


def test_it_says_who_has_3d_poses(report_scene: Scene) -> None:
    flat = keypoints_only(report_scene.recording, ["cam1"])
    rows = sightings(flat).partition("<tr>")[2].split("<tr>")
    poses = [sum(len(t.frames) for t in c.tracks) for c in flat.cameras]
    assert "3D poses" in rows[0]
    assert f"{poses[0]} of {poses[0]}" in rows[1]
    assert "none" in rows[2]
    assert sightings(keypoints_only(report_scene.recording)).count("none") == 3


def test_another_unit_is_named(report_content: ReportContent) -> None:
    html = html_of(report_content, metric=False)
    assert "[baselines]" in html
    assert "distances between the first two cameras" in html


def test_names_are_anybodys_text(report_scene: Scene) -> None:
    names = ("</script><script>alert(1)</script>", 'b"&amp;', "$x^2$ _{")
    cameras = tuple(
        dataclasses.replace(camera, name=name)
        for camera, name in zip(report_scene.recording.cameras, names, strict=True)
    )
    recording = dataclasses.replace(report_scene.recording, cameras=cameras)
    stranger = left_out("<img src=x>", "saw <b>nobody</b>")
    content = content_of_stages(recording, run_stages(recording))
    page = Page(html_of(content, uncalibrated=(stranger,)))
    assert page.tags.count("script") == 3
    assert "img" not in page.tags
    assert all(name in page.text for name in (*names, "<img src=x>", "saw <b>nobody</b>"))


def test_cameras_that_are_not_calibrated(report_content: ReportContent) -> None:
    lost = left_out("cam7", "shares nobody's motion with cam0, cam1")
    page = Page(html_of(report_content, uncalibrated=(lost,)))
    assert "3 of 4 cameras" in page.text
    assert "Calibrated, with remarks" in page.text
    assert lost.reason in page.text


TWO = Rejection(RejectionReason.UNSPECIFIED, detail="two solutions fit")


def test_refused_with_poses(report_content: ReportContent) -> None:
    page = Page(html_of(report_content, status=Status.DEGENERATE, rejections=(TWO,)))
    assert page.text.strip().startswith("Calibration refused\n")
    assert "Refused: the data does not determine the cameras" in page.text
    assert "Two solutions fit. UNSPECIFIED" in page.text
    assert "Found, but not to be used: 3 of 3 cameras" in page.text
    assert "must not be used" in page.text
    assert page.text.index("Why it was refused") < page.text.index("Cameras and people in 3D")


def test_refused_without_poses(report_scene: Scene) -> None:
    recording = Recording(report_scene.recording.cameras[:1])
    stages = run_stages(recording)
    assert stages.calibration.status is Status.INSUFFICIENT_DATA
    page = Page(report_html(content_of_stages(recording, stages)))
    assert "Refused: not enough data" in page.text
    assert "record two or more that see the same people" in page.text
    assert "could not be computed" in page.text
    assert "Images and people over time" in page.text
    assert "script" not in page.tags


@pytest.mark.parametrize("status", Status)
def test_every_status_has_its_words(status: Status, report_content: ReportContent) -> None:
    bare = dataclasses.replace(report_content, evidence=None)
    html = html_of(bare, cameras=(), persons=(), pairs=(), n_inliers=0, status=status)
    assert ("Refused" in html) == (status not in (Status.OK, Status.CANCELLED))


def test_unknown_numbers_are_left_out(report_content: ReportContent) -> None:
    cameras = tuple(
        dataclasses.replace(c, covariance=np.full((6, 6), np.nan), time_offset_stddev_s=np.nan)
        for c in report_content.calibration.cameras
    )
    page = Page(html_of(report_content, cameras=cameras))
    assert not re.search(r"\bnan\b", page.text)


def test_it_is_written_whole_or_not_at_all(tmp_path: Path, report_content: ReportContent) -> None:
    path = tmp_path / "report.html"
    write_report(report_content, path)
    assert path.read_text(encoding="utf-8").endswith("</html>\n")
    with pytest.raises(InputError, match="cannot write"):
        write_report(report_content, tmp_path / "no" / "report.html")
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
