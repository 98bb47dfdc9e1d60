from __future__ import annotations

import json
from pathlib import Path

import pytest
from pose_files import assert_read, convert, scene, seen_by
from pose_writers import N, mmpose_instance, mmpose_videos

from stcalib_ros.cli import main

ARGUMENTS = ["--fps", "30", "--image-size", "1920x1080"]


@pytest.mark.parametrize("described", [True, False])
def test_videos(tmp_path: Path, described: bool, capsys: pytest.CaptureFixture[str]) -> None:
    recording = convert(mmpose_videos(tmp_path / "mm", described=described), *ARGUMENTS)
    assert "Read as mmpose" in capsys.readouterr().out
    for camera, own in zip(recording.cameras, scene().cameras, strict=True):
        assert camera.name == own.name, "what the program adds to it is taken away"
        assert_read(camera, seen_by(own, "coco_17", N), tracked=False)
        assert max(track.scores.max() for track in camera.tracks) == 1.0


def test_images(tmp_path: Path) -> None:
    """A folder for each camera; an image without people is an empty list."""
    for camera in scene().cameras:
        (tmp_path / "mm" / camera.name).mkdir(parents=True)
        for k, people in enumerate(seen_by(camera, "coco_17", N)):
            content = json.dumps([mmpose_instance(one) for one in people] if k else [])
            (tmp_path / "mm" / camera.name / f"{k:06d}.json").write_text(content)
    recording = convert(tmp_path / "mm", *ARGUMENTS)
    for camera, own in zip(recording.cameras, scene().cameras, strict=True):
        assert_read(camera, [[], *seen_by(own, "coco_17", N)[1:]], tracked=False)


@pytest.mark.parametrize(
    "content",
    [
        '{"instance_info": 3}',
        '{"meta_info": {}}',
        '[{"frame_id": -1, "instances": []}]',
        '[{"frame_id": 0, "instances": [{"keypoints": [[1, 2, 3]], "keypoint_scores": [1]}]}]',
        '[{"keypoint_scores": [1], "keypoints": [[1, 2], [3, 4]]}]',
    ],
)
def test_unusable(tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str) -> None:
    (tmp_path / "x.json").write_text(content)
    assert main(["convert", str(tmp_path / "x.json"), str(tmp_path / "o.mcap"), *ARGUMENTS]) == 2
    assert "is not a result of MMPose" in capsys.readouterr().err
