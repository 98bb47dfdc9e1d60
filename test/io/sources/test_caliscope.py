from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pose_files import assert_read, convert, scene, seen_by

from stcalib_ros.cli import main

N = 8
FIRST_S = 47389.9


def project(root: Path, *, old: bool = False) -> Path:
    """Times are those of a counter; nobody is in the last image of any camera."""
    recording = root / "recordings" / "walk"
    tracker = recording / ("HOLISTIC" if old else "RTMPOSE_M_HALPE26")
    tracker.mkdir(parents=True)
    names = (
        "port,frame_index,frame_time,point_id"
        if old
        else "cam_id,frame_index,frame_time,object_id,keypoint_id"
    )
    rows, times, lenses = [], [], []
    for c, camera in enumerate(scene().cameras):
        images = seen_by(camera, "blazepose_33" if old else "halpe_26", N)
        for k, people in enumerate(images):
            stamp = FIRST_S + 0.001 * c + k / 30
            times.append(f"{k},{c},{stamp}")
            for one in (people[:1] if old else people) if k < N - 1 else []:
                for joint in np.flatnonzero(one.points.any(-1)):
                    person = "" if old else f"{one.track},"
                    x, y = one.points[joint, :2]
                    rows.append(f"{k},{c},{k},{stamp},{person}{joint},{x},{y}")
            if old and people:
                rows.append(f"{k},{c},{k},{stamp},105,7.0,7.0")
        lenses.append(
            f"[cameras.{c}]\ncam_id = {c}\nsize = [1920, 1080]\nignore = false\n"
            f"matrix = {camera.intrinsics.K.tolist()}\ndistortions = [0.0, 0.0, 0.0, 0.0, 0.0]\n"
        )
    table = "\n".join([f"sync_index,{names},img_loc_x,img_loc_y", *rows])
    (tracker / f"xy_{tracker.name}.csv").write_text(table + "\n")
    (recording / "timestamps.csv").write_text("\n".join(["sync_index,cam_id,frame_time", *times]))
    (root / "camera_array.toml").write_text("\n".join(lenses))
    board = root / "calibration" / "extrinsic" / "CHARUCO"
    board.mkdir(parents=True)
    (board / "xy_CHARUCO.csv").write_text(
        "sync_index,cam_id,keypoint_id,img_loc_x,img_loc_y\n0,0,0,1,1\n"
    )
    return root


def test_project(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording = convert(project(tmp_path / "p"))
    assert "Read as caliscope" in capsys.readouterr().out
    firsts = [camera.stamps[0] for camera in recording.cameras]
    np.testing.assert_allclose(np.diff(firsts), 0.001, atol=2e-6)
    for camera, own in zip(recording.cameras, scene().cameras, strict=True):
        np.testing.assert_allclose(np.diff(camera.stamps), 1 / 30, atol=2e-6)
        np.testing.assert_allclose(camera.intrinsics.K, own.intrinsics.K)
        assert_read(camera, [*seen_by(own, "halpe_26", N)[:-1], []], tracked=True)


def test_older_releases(tmp_path: Path) -> None:
    """One person of MediaPipe, with points of hands, which are not used."""
    recording = convert(project(tmp_path / "p", old=True) / "recordings" / "walk")
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
    root = project(tmp_path / "p")
    (table,) = (root / "recordings").rglob("xy_*.csv")
    (table.parent / "xy_OTHER.csv").write_text(table.read_text())
    assert main(["convert", str(root), str(tmp_path / "o.mcap")]) == 2
    assert "expected one table of people" in capsys.readouterr().err
