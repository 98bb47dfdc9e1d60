from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from pose_files import assert_read, convert, scene, seen_by

from stcalib_ros.cli import main

N = 8


def project(root: Path, *, names: list[str], rate: str) -> Path:
    """A trial in a batch, whose calibration is in the folder above; cameras are cam01 and so on."""
    trial = root / "Trial_1"
    lenses = []
    for k, camera in enumerate(scene().cameras):
        folder = trial / "pose" / f"cam{k + 1:02d}_json"
        folder.mkdir(parents=True)
        for f, people in enumerate(seen_by(camera, "halpe_26", N)):
            found = [
                {"person_id": [-1], "pose_keypoints_2d": one.points.ravel().tolist()}
                for one in people
            ]
            content = json.dumps({"version": 1.3, "people": found})
            (folder / f"cam{k + 1:02d}_{f:06d}.json").write_text(content)
        lens = camera.intrinsics
        lenses.append(
            f'[{names[k]}]\nname = "{names[k]}"\nsize = [1920.0, 1080.0]\n'
            f"matrix = {lens.K.tolist()}\ndistortions = [0.0, 0.0, 0.0, 0.0]\n"
            "rotation = [0.0, 0.0, 0.0]\ntranslation = [0.0, 0.0, 0.0]\nfisheye = false\n"
        )
    (root / "calibration").mkdir()
    calibration = "\n".join([*lenses, "[metadata]\nadjusted = false\nerror = 0.0\n"])
    (root / "calibration" / "Calib_board.toml").write_text(calibration)
    (trial / "Config.toml").write_text("[project]\nmulti_person = true\n")
    (root / "Config.toml").write_text(f"[project]\nframe_rate = {rate}\n")
    return trial


def write_video(path: Path, size: tuple[int, int], fps: float) -> None:
    path.parent.mkdir(exist_ok=True)
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), fps, size)
    assert video.isOpened()
    for _ in range(3):
        video.write(np.zeros((size[1], size[0], 3), np.uint8))
    video.release()


@pytest.mark.parametrize("names", [["cam01", "cam02", "cam03"], ["int_a", "int_b", "int_c"]])
def test_lenses_by_name_or_in_order(
    tmp_path: Path, names: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    recording = convert(project(tmp_path, names=names, rate="25"))
    assert "Read as pose2sim" in capsys.readouterr().out
    for camera, own in zip(recording.cameras, scene().cameras, strict=True):
        np.testing.assert_allclose(camera.intrinsics.K, own.intrinsics.K)
        np.testing.assert_allclose(np.diff(camera.stamps), 1 / 25, atol=1e-6)
        assert_read(camera, seen_by(own, "halpe_26", N), tracked=False)


def test_the_frame_rate_is_that_of_the_videos(tmp_path: Path) -> None:
    trial = project(tmp_path, names=["cam01", "cam02", "cam03"], rate="'auto'")
    for k, fps in enumerate((20, 25, 50)):
        write_video(trial / "videos" / f"cam{k + 1:02d}.mp4", (1920, 1080), fps)
    recording = convert(trial)
    periods = [float(np.diff(camera.stamps).mean()) for camera in recording.cameras]
    np.testing.assert_allclose(periods, [1 / 20, 1 / 25, 1 / 50], atol=1e-6)


def test_nothing_says_the_frame_rate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trial = project(tmp_path, names=["cam01", "cam02", "cam03"], rate="'auto'")
    assert main(["convert", str(trial), str(tmp_path / "o.mcap")]) == 2
    assert "give --fps HZ" in capsys.readouterr().err
    (trial / "videos").mkdir()
    (trial / "videos" / "cam01.mp4").write_bytes(b"no video")
    assert main(["convert", str(trial), str(tmp_path / "o.mcap")]) == 2
    assert "cannot read the video" in capsys.readouterr().err


def test_any_source_takes_what_its_videos_say(tmp_path: Path) -> None:
    trial = project(tmp_path, names=["cam01", "cam02", "cam03"], rate="'auto'")
    for k in range(3):
        write_video(tmp_path / "films" / f"cam{k + 1:02d}.mp4", (640, 360), 10)
    arguments = ["--format", "openpose", "--videos", str(tmp_path / "films")]
    recording = convert(trial / "pose", *arguments)
    for camera in recording.cameras:
        assert (camera.intrinsics.width, camera.intrinsics.height) == (640, 360)
        np.testing.assert_allclose(np.diff(camera.stamps), 0.1, atol=1e-6)
