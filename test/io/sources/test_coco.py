"""COCO's JSON: annotations, results of detectors, and AlphaPose's."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from pose_files import assert_read, convert, scene, seen_by
from pose_writers import N, alphapose, coco_annotations, coco_results

from stcalib_ros.cli import main
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS

SIZE = ["--image-size", "1920x1080"]


@pytest.mark.parametrize("tracked", [True, False])
def test_alphapose(tmp_path: Path, tracked: bool, capsys: pytest.CaptureFixture[str]) -> None:
    recording = convert(alphapose(tmp_path / "ap", tracked=tracked), "--fps", "30", *SIZE)
    assert "Read as alphapose" in capsys.readouterr().out
    for camera, own in zip(recording.cameras, scene().cameras, strict=True):
        assert camera.layout is LAYOUTS["halpe_26"]
        assert_read(camera, seen_by(own, "halpe_26", N), tracked=tracked)


@pytest.mark.parametrize(
    ("people", "joints"), [("people", "pose_keypoints_2d"), ("bodies", "joints")]
)
def test_alphapose_in_the_forms_of_others(tmp_path: Path, people: str, joints: str) -> None:
    """``--format open`` and ``cmu``: a dictionary of the images, and a file for each beside it."""
    for camera in scene().cameras:
        images = {
            f"walk_{k}.jpg": {
                "version": "AlphaPose v0.3",
                people: [{joints: one.points.ravel().tolist()} for one in seen],
            }
            for k, seen in enumerate(seen_by(camera, "coco_18", N))
        }
        folder = tmp_path / "ap" / camera.name
        (folder / "sep-json").mkdir(parents=True)
        (folder / "alphapose-results.json").write_text(json.dumps(images))
        for name, content in images.items():
            (folder / "sep-json" / f"{name[:-4]}.json").write_text(json.dumps(content))
    recording = convert(tmp_path / "ap", "--fps", "30", *SIZE)
    for read, camera in zip(recording.cameras, scene().cameras, strict=True):
        assert read.layout is LAYOUTS["coco_18"]
        assert_read(read, seen_by(camera, "coco_18", N), tracked=False)


def test_paths_of_windows(tmp_path: Path) -> None:
    """The folder of an image is its camera, whichever the slashes."""
    text = coco_annotations(tmp_path / "all.json").read_text()
    (tmp_path / "all.json").write_text(
        text.replace("cam", "C:\\\\data\\\\cam").replace("/", "\\\\")
    )
    recording = convert(tmp_path / "all.json", "--fps", "30")
    assert [camera.name for camera in recording.cameras] == ["cam0", "cam1", "cam2"]


def test_images_without_people_are_images(tmp_path: Path) -> None:
    """A list of results has none of them: they are those between the others."""
    for c, name in enumerate(("a", "b")):
        items = [
            item
            for item in coco_results(c, "coco_17")
            if item["image_id"] not in ("3.jpg", "4.jpg")
        ]
        (tmp_path / "r").mkdir(exist_ok=True)
        (tmp_path / "r" / f"{name}.json").write_text(json.dumps(items))
    recording = convert(tmp_path / "r", "--fps", "30", *SIZE)
    expected = seen_by(scene().cameras[1], "coco_17", N)
    expected[3:5] = [[], []]
    assert_read(recording.cameras[1], expected, tracked=False)


def test_annotations(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Ids are track_id; people without a keypoint are nobody."""
    path = coco_annotations(tmp_path / "all.json")
    recording = convert(path, "--fps", "30")
    assert "Read as coco" in capsys.readouterr().out
    for camera, own in zip(recording.cameras, scene().cameras, strict=True):
        assert camera.intrinsics.width == 1920
        assert_read(camera, seen_by(own, "coco_17", N), tracked=True)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('[{"image_id": "a.jpg", "keypoints": [1, 2, 3]}]', "its name has no number of an image"),
        ('[{"image_id": "1.jpg", "keypoints": [1, 2]}]', "is not a list of COCO keypoints"),
        ('[{"image_id": "1.jpg", "keypoints": "x"}]', "is not a list of COCO keypoints"),
        (
            '[{"image_id": "1.jpg", "keypoints": [1, 2, 3]}]',
            "poses of 1 keypoints, but does not say",
        ),
        ('[{"image_id": "1.jpg", "keypoints": [1, 2, 3], "idx": 1e300}]', "is no number of an im"),
        ('{"images": [], "annotations": [{"image_id": 4, "keypoints": [1]}]}', "KeyError: 4"),
        ('{"images": [], "annotations": []}', "has no files of poses that can be read"),
    ],
)
def test_unusable(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str, message: str
) -> None:
    (tmp_path / "x.json").write_text(content)
    arguments = [str(tmp_path / "x.json"), str(tmp_path / "o.mcap"), "--fps", "30", *SIZE]
    assert main(["convert", *arguments]) == 2
    assert message in capsys.readouterr().err


def test_fractions_of_the_image_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    keypoints = [0.5, 0.25, 1.0] * 17
    (tmp_path / "a.json").write_text(json.dumps([{"image_id": 1, "keypoints": keypoints}]))
    arguments = ["--fps", "30", "--image-size", "1920x1080", "--format", "coco"]
    assert main(["convert", str(tmp_path / "a.json"), str(tmp_path / "o.mcap"), *arguments]) == 2
    assert "as if they were fractions of it: write them in pixels" in capsys.readouterr().err
