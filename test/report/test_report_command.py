"""``stcalib calibrate --report``."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import pytest

from stcalib_ros.cli import main
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.synthetic import Scene
from stcalib_ros.io.bag_writer import write_bag


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
    assert "3 of 3 cameras, 2 persons" in (tmp_path / "out.html").read_text()
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


def test_without_matplotlib_it_ends_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert calibrate(tmp_path / "missing.mcap") == 2
    assert capsys.readouterr().err == (
        "stcalib: --report needs Matplotlib, which is not installed: "
        "pip install 'stcalib-ros[report]'\n"
    )


def test_the_report_is_tried_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--output", str(tmp_path / "a.yaml"), "--report", str(tmp_path / "no" / "a.html")]
    assert main(["calibrate", str(tmp_path / "missing.mcap"), *arguments]) == 2
    assert "no such folder" in capsys.readouterr().err
