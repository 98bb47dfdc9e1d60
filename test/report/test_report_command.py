"""``stcalib report`` and ``stcalib calibrate --report``."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import pytest

from stcalib_ros.cli import main
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.synthetic import Scene
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.results import write_result
from stcalib_ros.report.content import ReportContent
from stcalib_ros.report.three_js import three_js


def calibrate(bag: Path, *more: str) -> int:
    folder = bag.parent
    arguments = ["--output", str(folder / "out.yaml"), "--report", str(folder / "out.html")]
    return main(["calibrate", str(bag), *arguments, *more])


def write(recording: Recording, folder: Path) -> Path:
    write_bag(recording, folder / "bag.mcap")
    return folder / "bag.mcap"


def test_a_report_beside_the_result(
    tmp_path: Path, report_scene: Scene, capsys: pytest.CaptureFixture[str]
) -> None:
    assert calibrate(write(report_scene.recording, tmp_path)) == 0
    assert "3 of 3 cameras placed by 2 people" in (tmp_path / "out.html").read_text()
    said = capsys.readouterr().out
    assert f"Written to {tmp_path / 'out.yaml'} and {tmp_path / 'out.html'}" in said


def test_a_report_of_a_refusal(
    tmp_path: Path, report_scene: Scene, capsys: pytest.CaptureFixture[str]
) -> None:
    alone = dataclasses.replace(report_scene.recording, cameras=report_scene.recording.cameras[:1])
    assert calibrate(write(alone, tmp_path), "--quiet") == 3
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bag.mcap", "out.html"]
    assert "Refused" in (tmp_path / "out.html").read_text()
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith(f"(report: {tmp_path / 'out.html'})")


def test_without_its_library_it_ends_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "trimesh", None)
    assert calibrate(tmp_path / "missing.mcap") == 2
    assert capsys.readouterr().err == (
        "stcalib: a report needs trimesh, which carries three.js: "
        "pip install 'stcalib-ros[report]'\n"
    )


def test_a_library_without_three_js(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "trimesh").mkdir()
    (tmp_path / "trimesh/__init__.py").touch()
    monkeypatch.delitem(sys.modules, "trimesh", raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InputError, match=r"viewer\.zip has none"):
        three_js()


def test_the_report_is_tried_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--output", str(tmp_path / "a.yaml"), "--report", str(tmp_path / "no" / "a.html")]
    assert main(["calibrate", str(tmp_path / "missing.mcap"), *arguments]) == 2
    assert "no such folder" in capsys.readouterr().err


@pytest.fixture(scope="module")
def finished(report_content: ReportContent, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finished")
    write_bag(report_content.recording, folder / "bag.mcap")
    write_result(report_content.calibration, folder / "out.yaml")
    return folder


def test_a_report_of_a_finished_result(
    finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result, bag, figures = finished / "out.yaml", finished / "bag.mcap", tmp_path / "figures"
    assert main(["report", str(result), str(bag), "--figures", str(figures)]) == 0
    html = (finished / "out.html").read_text()
    assert "3 of 3 cameras placed by 2 people" in html
    assert "Residuals are those of this recording by the finished result" in html
    said = capsys.readouterr().out
    assert said.startswith(f"Written to {finished / 'out.html'}, ")
    assert len(list(figures.iterdir())) == 8


def test_a_report_of_a_refused_result(finished: Path, tmp_path: Path) -> None:
    text = (finished / "out.yaml").read_text().replace("status: OK", "status: DEGENERATE")
    (tmp_path / "out.rejected.yaml").write_text(text)
    arguments = ["report", str(tmp_path / "out.rejected.yaml"), str(finished / "bag.mcap")]
    assert main([*arguments, "-o", str(tmp_path / "a.html")]) == 0
    html = (tmp_path / "a.html").read_text()
    assert "Refused: the data does not determine the cameras" in html
    assert "must not be used" in html


def test_a_bag_of_other_cameras(
    finished: Path, tmp_path: Path, report_scene: Scene, capsys: pytest.CaptureFixture[str]
) -> None:
    cameras = [dataclasses.replace(c, name=f"x{c.name}") for c in report_scene.recording.cameras]
    other = dataclasses.replace(report_scene.recording, cameras=tuple(cameras))
    output = tmp_path / "a.html"
    arguments = ["report", str(finished / "out.yaml"), str(write(other, tmp_path))]
    assert main([*arguments, "-o", str(output)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "the recording has xcam0, xcam1, xcam2" in line
    assert not output.exists()


def test_a_bag_that_does_not_agree(
    finished: Path,
    tmp_path: Path,
    report_content: ReportContent,
    capsys: pytest.CaptureFixture[str],
) -> None:
    first, *others = report_content.calibration.cameras
    shifted = [dataclasses.replace(c, time_offset_s=c.time_offset_s + 1.0) for c in others]
    other = dataclasses.replace(report_content.calibration, cameras=(first, *shifted))
    write_result(other, tmp_path / "other.yaml")
    bag = str(finished / "bag.mcap")
    assert main(["report", str(tmp_path / "other.yaml"), bag, "-o", str(tmp_path / "a.html")]) == 0
    assert "does not agree with" in capsys.readouterr().err
    assert "not agree with the result</h1>" in (tmp_path / "a.html").read_text()
