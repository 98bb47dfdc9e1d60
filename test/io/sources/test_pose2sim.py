from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from pose_files import assert_read, convert, scene, seen_by
from pose_writers import N, pose2sim, write_video

from stcalib_ros.cli import main


@pytest.mark.parametrize("names", [["cam01", "cam02", "cam03"], ["int_a", "int_b", "int_c"]])
def test_lenses_by_name_or_in_order(
    tmp_path: Path, names: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    recording = convert(pose2sim(tmp_path, names=names, rate="25"))
    assert "Read as pose2sim" in capsys.readouterr().out
    for camera, own in zip(recording.cameras, scene().cameras, strict=True):
        np.testing.assert_allclose(camera.intrinsics.K, own.intrinsics.K)
        np.testing.assert_allclose(np.diff(camera.stamps), 1 / 25, atol=1e-6)
        assert_read(camera, seen_by(own, "halpe_26", N), tracked=False)


def test_the_frame_rate_is_that_of_the_videos(tmp_path: Path) -> None:
    trial = pose2sim(tmp_path, names=["cam01", "cam02", "cam03"], rate="'auto'")
    for k, fps in enumerate((20, 25, 50)):
        write_video(trial / "videos" / f"cam{k + 1:02d}.mp4", (1920, 1080), fps)
    recording = convert(trial)
    periods = [float(np.diff(camera.stamps).mean()) for camera in recording.cameras]
    np.testing.assert_allclose(periods, [1 / 20, 1 / 25, 1 / 50], atol=1e-6)


def test_nothing_says_the_frame_rate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trial = pose2sim(tmp_path, names=["cam01", "cam02", "cam03"], rate="'auto'")
    assert main(["convert", str(trial), str(tmp_path / "o.mcap")]) == 2
    assert "give --fps HZ" in capsys.readouterr().err
    (trial / "videos").mkdir()
    (trial / "videos" / "cam01.mp4").write_bytes(b"no video")
    assert main(["convert", str(trial), str(tmp_path / "o.mcap")]) == 2
    assert "cannot read the video" in capsys.readouterr().err


def test_a_batch_is_its_trial_if_it_has_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = pose2sim(tmp_path / "batch", names=["cam01", "cam02", "cam03"], rate="25").parent
    assert [camera.intrinsics.known for camera in convert(root).cameras] == 3 * [True]
    shutil.copytree(root / "Trial_1", root / "Trial_2")
    assert main(["convert", str(root), str(tmp_path / "o.mcap")]) == 2
    assert "has 2 trials of Pose2Sim: name one: Trial_1, Trial_2" in capsys.readouterr().err


def test_any_source_takes_what_its_videos_say(tmp_path: Path) -> None:
    trial = pose2sim(tmp_path, names=["cam01", "cam02", "cam03"], rate="'auto'")
    for k in range(3):
        write_video(tmp_path / "films" / f"cam{k + 1:02d}.mp4", (1800, 1000), 10)
    arguments = ["--format", "openpose", "--videos", str(tmp_path / "films")]
    recording = convert(trial / "pose", *arguments)
    for camera in recording.cameras:
        assert (camera.intrinsics.width, camera.intrinsics.height) == (1800, 1000)
        np.testing.assert_allclose(np.diff(camera.stamps), 0.1, atol=1e-6)
