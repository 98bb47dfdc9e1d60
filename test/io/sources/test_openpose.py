from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pose_files import FPS, assert_read, convert, scene, seen_by, write_lenses
from pose_writers import openpose, openpose_person, write_openpose_image

from stcalib_ros.cli import main
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.io.bag import read_bag


def test_given_lenses_go_into_the_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, lenses = openpose(tmp_path / "op", 2), write_lenses(tmp_path / "lenses")
    bag = tmp_path / "w.mcap"
    arguments = ["--fps", "30", "--intrinsics", str(lenses)]
    assert main(["convert", str(source), str(bag), *arguments]) == 0
    said = capsys.readouterr().out
    assert "Read as openpose" in said
    assert f"Next: stcalib calibrate {bag} --output w.yaml\n" in said
    for camera, own in zip(read_bag(bag).cameras, scene().cameras, strict=True):
        np.testing.assert_allclose(camera.intrinsics.K, own.intrinsics.K)


def test_without_a_lens_the_next_command_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    convert(openpose(tmp_path / "op", 2), "--fps", "30", "--image-size", "1920x1080")
    said = capsys.readouterr().out
    assert "2 images, 6 poses (body_25), no ids, 1920 x 1080 px, lens unknown" in said
    assert said.endswith("--intrinsics unknown\n")


@pytest.mark.parametrize("layout", ["body_25", "coco_18", "halpe_26"])
def test_every_pose_is_read(tmp_path: Path, layout: str) -> None:
    recording = convert(
        openpose(tmp_path / "op", 12, layout), "--fps", "30", "--image-size", "1920x1080"
    )
    for camera, own in zip(recording.cameras, scene().cameras, strict=True):
        assert camera.layout is LAYOUTS[layout]
        assert not camera.intrinsics.known
        assert (camera.intrinsics.width, camera.intrinsics.height) == (1920, 1080)
        np.testing.assert_allclose(np.diff(camera.stamps), 1 / FPS, atol=1e-6)
        assert_read(camera, seen_by(own, layout, 12), tracked=False)


def test_ids_and_times_in_names(tmp_path: Path) -> None:
    """Cameras by how the names begin; stamps of 40 ms, in us; ids of OpenPose's tracking."""
    cameras = scene().cameras[:2]
    for camera in cameras:
        for k, people in enumerate(seen_by(camera, "body_25", 6)):
            stamp = 1_760_000_000_000_000 + 40_000 * k
            found = [openpose_person(one, one.track) for one in people]
            write_openpose_image(tmp_path / "flat" / f"{camera.name}-{stamp}_keypoints.json", found)
    recording = convert(tmp_path / "flat", "--image-size", "1920x1080")
    assert recording.epoch_ns == 1_760_000_000 * 10**9
    for camera, own in zip(recording.cameras, cameras, strict=True):
        assert camera.name == own.name
        np.testing.assert_allclose(camera.stamps, 0.04 * np.arange(6))
        assert_read(camera, seen_by(own, "body_25", 6), tracked=True)


@pytest.mark.parametrize(("first", "side"), [(0.0, 1.0), (-1.0, 2.0)])
def test_fractions_of_the_image_are_pixels(tmp_path: Path, first: float, side: float) -> None:
    """As with ``--keypoint_scale`` 3 and 4, where what was not found is a corner."""
    own = scene().cameras[0]
    for k, people in enumerate(seen_by(own, "body_25", 4)):
        found = []
        for one in people:
            points = one.points / (1920 / side, 1080 / side, 1) + (first, first, 0)
            found.append(openpose_person(one._replace(points=points)))
        write_openpose_image(tmp_path / "op" / "a" / f"{k}.json", found)
    recording = convert(tmp_path / "op", "--fps", "30", "--image-size", "1920x1080")
    assert_read(recording.cameras[0], seen_by(own, "body_25", 4), tracked=False)


def test_a_folder_of_two_recordings_is_noticed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("monday", "tuesday"):
        openpose(tmp_path / "all" / name, 2)
    convert(tmp_path / "all", "--fps", "30", "--image-size", "1920x1080")
    said = capsys.readouterr().out
    assert "Cameras in monday and tuesday have the same names" in said
    assert f"convert one of them, {tmp_path / 'all' / 'monday'}\n" in said


def test_one_camera_alone_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = openpose(tmp_path / "op", 2) / "cam1_json"
    (camera,) = convert(source, "--fps", "30", "--image-size", "1920x1080").cameras
    assert camera.name == "cam1"
    assert capsys.readouterr().out.endswith("name the folder that has all of them\n")


def test_nobody_is_lost_where_all_have_one_id(tmp_path: Path) -> None:
    """As of programs that write 0 for everybody; a settings file lies beside them."""
    own = scene().cameras[0]
    for k, people in enumerate(seen_by(own, "body_25", 6)):
        found = [openpose_person(one, 0) for one in people]
        write_openpose_image(tmp_path / "op" / "a" / f"{k}.json", found)
        write_openpose_image(tmp_path / "op" / "b" / f"{k}.json", found)
    (tmp_path / "op" / "settings.json").write_text("{}")
    recording = convert(tmp_path / "op", "--fps", "30", "--image-size", "1920x1080")
    for camera in recording.cameras:
        n_poses = sum(len(track.frames) for track in camera.tracks)
        assert n_poses == sum(map(len, seen_by(own, "body_25", 6)))
        assert max(len(track.frames) for track in camera.tracks) == 6


def test_cameras_and_images_are_chosen(tmp_path: Path) -> None:
    source = openpose(tmp_path / "op", 12)
    size = ["--fps", "30", "--image-size", "1920x1080"]
    recording = convert(source, *size, "--cameras", "cam2,cam0", "--frames", "4:7")
    assert [camera.name for camera in recording.cameras] == ["cam0", "cam2"]
    assert_read(
        recording.cameras[0], seen_by(scene().cameras[0], "body_25", 12)[4:8], tracked=False
    )


@pytest.mark.parametrize(
    ("content", "arguments", "message"),
    [
        (None, [], "does not say the frame rate: give --fps HZ"),
        (None, ["--fps", "30"], "how large the images of cam0 are: give --image-size"),
        (None, ["--fps", "3e4"], "frame rate is 30000.0; give one of"),
        (None, ["--cameras", "cam7"], "has no camera cam7: there are cam0, cam1, cam2"),
        (None, ["--frames", "50:60"], "cam0 has images 0 to 1, none of 50 to 60"),
        (None, ["--sigma-px", "1"], "--sigma-px is for data sets, but"),
        (
            None,
            ["--truth", "t.yaml", "--fps", "30", "--image-size", "1920x1080"],
            "has no true poses",
        ),
        (
            None,
            ["--fps", "30", "--image-size", "64x48"],
            "100% of the keypoints of cam0 are outside of its image of 64 x 48 px",
        ),
        ('{"people": [{"pose_keypoints_2d": [1, 2]}]}', [], "is not a result of OpenPose"),
        ('{"people": [{"pose_keypoints_2d": "x"}]}', [], "is not a result of OpenPose"),
        ('{"people": 3}', [], "is not a result of OpenPose"),
        (
            '{"people": [{"pose_keypoints_2d": [0, 0, 0]}]}',
            ["--fps", "9"],
            "of 1 and of 25 keypoints",
        ),
        ('{"people": ', [], "is not valid JSON"),
    ],
)
def test_unusable(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    content: str | None,
    arguments: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    openpose(Path("op"), 2)
    if content is not None:
        Path("op/cam0_json/walk_000000000000_keypoints.json").write_text(content)
    assert main(["convert", "op", "out.mcap", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not Path("out.mcap").exists()
