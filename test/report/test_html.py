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
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.stages import Stages
from stcalib_ros.core.synthetic import Scene
from stcalib_ros.report.html import report_html, write_report
from stcalib_ros.report.tables import sightings

_VOID = {"meta", "img"}


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

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.sources += [v or "" for k, v in attrs if k in ("src", "href")]
        if tag not in _VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self.open:
            self.text += data


def changed(stages: Stages, **changes: object) -> Stages:
    return dataclasses.replace(
        stages, calibration=dataclasses.replace(stages.calibration, **changes)
    )


@pytest.fixture(scope="module")
def page(report_scene: Scene, report_stages: Stages) -> Page:
    return Page(report_html(report_scene.recording, report_stages, truth=report_scene.truth))


def test_it_needs_no_other_file(page: Page, report_scene: Scene, report_stages: Stages) -> None:
    assert len(page.sources) == 3
    assert all(source.startswith("data:image/png;base64,iVBOR") for source in page.sources)
    assert not {"script", "link", "iframe"} & set(page.tags)
    html = report_html(report_scene.recording, report_stages)
    assert not re.search(r"https?://|url\(|@import", html)


def test_it_says_what_was_found(page: Page, report_stages: Stages) -> None:
    calibration = report_stages.calibration
    assert page.text.strip().startswith("Calibration\n")
    for said in (
        "Calibrated",
        "The least constrained camera is cam",
        "Clock skews are not observable in ",
        f"3 of 3 cameras, 2 persons; {calibration.n_inliers} of {calibration.n_observations}",
        f"{calibration.reprojection_rms_px:.2f} px (rms)",
        "T_ref_cam: x_ref = R x_cam + t",
        "t_ref = t_cam + offset",
        "Lengths are in metres",
        f"{1e3 * calibration.cameras[1].time_offset_s:+.2f} ms ± ",
        "cam0, cam1",
        "30.0 Hz",
        "h36m_17",
    ):
        assert said in page.text
    assert "nan" not in page.text.lower().split()


def test_it_says_who_has_3d_poses(report_scene: Scene, report_stages: Stages) -> None:
    flat = keypoints_only(report_scene.recording, ["cam1"])
    rows = sightings(flat).partition("<tr>")[2].split("<tr>")
    poses = [sum(len(t.frames) for t in c.tracks) for c in flat.cameras]
    assert "3D poses" in rows[0]
    assert f"{poses[0]} of {poses[0]}" in rows[1]
    assert "none" in rows[2]
    html = report_html(keypoints_only(report_scene.recording), report_stages)
    assert Page(html).text.count("none") == 3


def test_another_unit_is_named(report_scene: Scene, report_stages: Stages) -> None:
    html = report_html(report_scene.recording, changed(report_stages, metric=False))
    assert "[baselines]" in html
    assert "distances between the first two cameras" in html


def test_names_are_anybodys_text(report_scene: Scene) -> None:
    names = ("<script>alert(1)</script>", 'b"&amp;', "$x^2$ _{")
    cameras = tuple(
        dataclasses.replace(camera, name=name)
        for camera, name in zip(report_scene.recording.cameras, names, strict=True)
    )
    recording = dataclasses.replace(report_scene.recording, cameras=cameras)
    stages = run_stages(recording)
    stranger = left_out("<img src=x>", "saw <b>nobody</b>")
    page = Page(report_html(recording, changed(stages, uncalibrated=(stranger,))))
    assert "script" not in page.tags
    assert len(page.sources) == 3
    assert all(name in page.text for name in (*names, "<img src=x>", "saw <b>nobody</b>"))


def test_cameras_that_are_not_calibrated(report_scene: Scene, report_stages: Stages) -> None:
    lost = left_out("cam7", "shares nobody's motion with cam0, cam1")
    page = Page(report_html(report_scene.recording, changed(report_stages, uncalibrated=(lost,))))
    assert "3 of 4 cameras" in page.text
    assert lost.reason in page.text


TWO = Rejection(RejectionReason.UNSPECIFIED, detail="two solutions fit")


def test_refused_with_poses(report_scene: Scene, report_stages: Stages) -> None:
    refused = changed(report_stages, status=Status.DEGENERATE, rejections=(TWO,))
    page = Page(report_html(report_scene.recording, refused))
    assert page.text.strip().startswith("Calibration refused\n")
    assert "Refused: the data does not determine the cameras" in page.text
    assert "Two solutions fit. Found: 3 of 3 cameras" in page.text
    assert "must not be used" in page.text


def test_refused_without_poses(report_scene: Scene) -> None:
    recording = Recording(report_scene.recording.cameras[:1])
    stages = run_stages(recording)
    assert stages.calibration.status is Status.INSUFFICIENT_DATA
    page = Page(report_html(recording, stages))
    assert "Refused: not enough data" in page.text
    assert "record two or more that see the same people" in page.text
    assert "There are no poses" in page.text
    assert len(page.sources) == 1


@pytest.mark.parametrize("status", Status)
def test_every_status_has_its_words(
    status: Status, report_scene: Scene, report_stages: Stages
) -> None:
    bare = dataclasses.replace(report_stages.calibration, cameras=(), persons=(), n_inliers=0)
    stages = dataclasses.replace(
        report_stages, calibration=dataclasses.replace(bare, status=status, pairs=())
    )
    html = report_html(report_scene.recording, stages)
    assert ("Refused" in html) == (status not in (Status.OK, Status.CANCELLED))


def test_unknown_numbers_are_left_out(report_scene: Scene, report_stages: Stages) -> None:
    cameras = tuple(
        dataclasses.replace(c, covariance=np.full((6, 6), np.nan), time_offset_stddev_s=np.nan)
        for c in report_stages.calibration.cameras
    )
    page = Page(report_html(report_scene.recording, changed(report_stages, cameras=cameras)))
    assert not re.search(r"\bnan\b", page.text)


def test_it_is_written_whole_or_not_at_all(
    tmp_path: Path, report_scene: Scene, report_stages: Stages
) -> None:
    path = tmp_path / "report.html"
    write_report(report_scene.recording, report_stages, path)
    assert path.read_text(encoding="utf-8").endswith("</html>\n")
    with pytest.raises(InputError, match="cannot write"):
        write_report(report_scene.recording, report_stages, tmp_path / "no" / "report.html")
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
