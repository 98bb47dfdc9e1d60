"""``stcalib simulate``."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import stcalib_ros
from stcalib_ros.cli import main
from stcalib_ros.commands import simulate as simulate_command
from stcalib_ros.core.synthetic import SceneOptions
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.results import read_result

TRUTH = str(Path(stcalib_ros.__file__).parent / "data" / "demo" / "balance_truth.yaml")


def test_every_option_of_a_scene_is_an_argument() -> None:
    assert set(simulate_command._HELP) == {f.name for f in dataclasses.fields(SceneOptions)}


RIG = {
    "cameras": [
        {
            "name": name,
            "image_size": [640, 480],
            "K": [[500, 0, 320], [0, 500, 240], [0, 0, 1]],
            "dist": [0, 0, 0, 0, 0],
            "R": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]]).tolist(),
            "t": [x, 1.5, 5.0],
        }
        for name, x in (("left", -1.0), ("right", 1.0))
    ]
}


def test_simulate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "rig.json").write_text(json.dumps(RIG))
    arguments = ["--rig", str(tmp_path / "rig.json"), "--n-frames", "12", "--seed", "4"]
    arguments += ["--fps", "30", "25", "--sigma-px", "0", "--lifter-mm", "10", "20", "--occlusions"]
    arguments += ["--line-time-s", "1e-5", "0"]
    for name in ("a", "b"):
        bag, answer = str(tmp_path / f"{name}.mcap"), str(tmp_path / f"{name}.yaml")
        assert main(["simulate", bag, "--truth", answer, *arguments]) == 0
    assert "Written to" in capsys.readouterr().out
    recording = read_bag(tmp_path / "a.mcap")
    assert [c.name for c in recording.cameras] == ["left", "right"]
    assert np.diff(recording.cameras[1].stamps) == pytest.approx(0.04)
    assert [c.name for c in read_result(tmp_path / "a.yaml").cameras] == ["left", "right"]
    assert [c.line_time_s for c in read_result(tmp_path / "a.yaml").cameras] == [1e-5, 0.0]
    for suffix in ("mcap", "yaml"):
        first, second = (tmp_path / f"{name}.{suffix}" for name in ("a", "b"))
        assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize(
    ("arguments", "flat"),
    [
        ([], ()),
        (["--keypoints-only"], ("cam0", "cam1", "cam2")),
        (["--keypoints-only-of", "cam2", "--keypoints-only-of", "cam0"], ("cam0", "cam2")),
    ],
)
def test_simulate_without_3d_poses(
    tmp_path: Path, arguments: list[str], flat: tuple[str, ...]
) -> None:
    bag = tmp_path / "a.mcap"
    assert main(["simulate", str(bag), "--n-cameras", "3", "--n-frames", "12", *arguments]) == 0
    recording = read_bag(bag)
    assert flat == tuple(
        camera.name
        for camera in recording.cameras
        if not any(np.isfinite(track.joints).any() for track in camera.tracks)
    )
    assert all(np.isfinite(t.keypoints).any() for c in recording.cameras for t in c.tracks)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--n-people", "0"], "n_people must be 1 to 1000, got 0"),
        (["--fps", "30", "25"], "2 values for 4 cameras"),
        (["--line-time-s", "1e-5", "2e-5"], "2 values for 4 cameras"),
        (["--focal-px", "900", "1000"], "2 values for 4 cameras"),
        (["--rig", "missing.json"], "no such file: missing.json"),
        (["--rig", TRUTH], "is not valid JSON"),
        (["--missing", "1.5"], "missing must be a fraction"),
        (
            ["--n-frames", "5", "--keypoints-only-of", "door"],
            "--keypoints-only-of door: no such camera; there are cam0, cam1, cam2, cam3",
        ),
    ],
)
def test_simulate_unusable(
    tmp_path: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", str(tmp_path / "a.mcap"), *arguments]) == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_bag_folder_is_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", str(tmp_path), "--n-frames", "5"]) == 2
    assert "it exists; remove it or name another" in capsys.readouterr().err
