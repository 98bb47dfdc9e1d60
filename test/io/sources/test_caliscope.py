from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pose_files import assert_read, convert, scene, seen_by
from pose_writers import N, caliscope

from stcalib_ros.cli import main


def test_project(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording = convert(caliscope(tmp_path / "p"))
    assert "Read as caliscope" in capsys.readouterr().out
    firsts = [camera.stamps[0] for camera in recording.cameras]
    np.testing.assert_allclose(np.diff(firsts), 0.001, atol=2e-6)
    for camera, own in zip(recording.cameras, scene().cameras, strict=True):
        np.testing.assert_allclose(np.diff(camera.stamps), 1 / 30, atol=2e-6)
        np.testing.assert_allclose(camera.intrinsics.K, own.intrinsics.K)
        assert_read(camera, [*seen_by(own, "halpe_26", N)[:-1], []], tracked=True)


def test_older_releases(tmp_path: Path) -> None:
    """One person of MediaPipe, with points of hands, which are not used."""
    recording = convert(caliscope(tmp_path / "p", old=True) / "recordings" / "walk")
    for camera, own in zip(recording.cameras, scene().cameras, strict=True):
        assert camera.layout.name == "blazepose_33"
        (track,) = camera.tracks
        first = seen_by(own, "blazepose_33", N)[0][0].points
        known = first.any(-1)
        np.testing.assert_allclose(track.keypoints[0][known], first[known, :2], atol=2e-3)
        assert np.isnan(track.keypoints[0][~known]).all()


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("0,0,0,x,0,1,1.0,1.0", "frame_time has a value that is no number"),
        ("0,0,0,1e300,0,1,1.0,1.0", "frame_time has 1e+300, more than a stamp can hold"),
        ("0,0,0,1.0,0,1,1.0", "row 2 has 7 values, the header 8"),
        ("0,-4,0,1.0,0,1,1.0,1.0", "-4 is no number of an image"),
        ("0,0,0,1.0,0,1,one,1.0", "is not a table of Caliscope's points"),
        ("", "has a header, but no rows"),
    ],
)
def test_unusable(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], rows: str, message: str
) -> None:
    names = "sync_index,cam_id,frame_index,frame_time,object_id,keypoint_id,img_loc_x,img_loc_y"
    (tmp_path / "xy_X.csv").write_text(f"{names}\n{rows}\n")
    assert main(["convert", str(tmp_path), str(tmp_path / "o.mcap"), "--image-size", "9x9"]) == 2
    assert message in capsys.readouterr().err


def test_two_trackers_are_one_too_many(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = caliscope(tmp_path / "p")
    (table,) = (root / "recordings").rglob("xy_*.csv")
    (table.parent / "xy_OTHER.csv").write_text(table.read_text())
    assert main(["convert", str(root), str(tmp_path / "o.mcap")]) == 2
    assert "has several tables of people: name one: " in capsys.readouterr().err


def test_boards_alone_are_no_people(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = caliscope(tmp_path / "p")
    (table,) = (root / "recordings").rglob("xy_*.csv")
    table.unlink()
    assert main(["convert", str(root), str(tmp_path / "o.mcap")]) == 2
    assert "has no table of people, xy_TRACKER.csv, but 1 of boards" in capsys.readouterr().err
