"""``stcalib estimate``, and ``stcalib calibrate`` of films, as a user runs them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from film_helpers import NumberEstimator, write_film, write_scene_films

import stcalib_ros as st
from stcalib_ros.cli import main
from stcalib_ros.io.bag_origin import read_origin

SCENE = st.SceneOptions(n_cameras=3, n_people=2, n_frames=70, fps=10.0, image_size=(640, 480))


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Path], st.Recording]:
    folder = tmp_path_factory.mktemp("scene")
    films, recording = write_scene_films(folder, SCENE)
    st.write_camera_info(st.simulate(SCENE).truth, folder / "lenses")
    return folder, films, recording


@pytest.fixture
def estimator(
    scene: tuple[Path, dict[str, Path], st.Recording], monkeypatch: pytest.MonkeyPatch
) -> list[str]:
    """The estimator of the scene in place of all others; their names as they were asked for."""
    asked: list[str] = []

    def load(name: str, **_: Any) -> NumberEstimator:
        asked.append(name)
        return NumberEstimator(scene[0] / "poses.npz")

    monkeypatch.setattr("stcalib_ros.estimation.registry.load_estimator", load)
    return asked


def test_films_become_a_bag_and_nothing_else_stays(
    scene: tuple[Path, dict[str, Path], st.Recording],
    estimator: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    films = [str(path) for path in scene[1].values()]
    output = tmp_path / "walk.mcap"
    command = ["estimate", *films, "--output", str(output), "--jobs", "1", "--estimator", "mine"]
    assert main([*command, "--intrinsics", str(scene[0] / "lenses")]) == 0
    found = st.read_bag(output)
    assert [len(camera.stamps) for camera in found.cameras] == [70, 70, 70]
    assert all(camera.intrinsics.known for camera in found.cameras)
    assert [path.name for path in tmp_path.iterdir()] == ["walk.mcap"]
    assert read_origin(output)["estimator"] == "mine"
    assert set(estimator) == {"mine"}
    said = capsys.readouterr().out
    assert "count as begun together" in said
    assert f"Next: stcalib calibrate {output}" in said


def test_films_are_calibrated_in_one_command_and_estimated_once(
    scene: tuple[Path, dict[str, Path], st.Recording],
    estimator: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    output = tmp_path / "walk.yaml"
    command = ["calibrate", *map(str, scene[1].values()), "--output", str(output)]
    command += ["--intrinsics", str(scene[0] / "lenses")]
    assert main(command) == 0
    truth = st.simulate(SCENE).truth
    calibration = st.read_result(output)
    assert st.evaluate(calibration, truth).E_R < 0.01
    assert f"The poses of the films are in {tmp_path / 'walk.mcap'}" in capsys.readouterr().err
    estimator.clear()
    assert main(command) == 0
    assert "used as they are" in capsys.readouterr().err
    assert estimator == []
    assert read_origin(tmp_path / "walk.mcap")["fps_limit"] == "10"


def test_a_bag_that_is_not_of_films_is_not_replaced(
    scene: tuple[Path, dict[str, Path], st.Recording],
    estimator: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    st.write_bag(scene[2], tmp_path / "walk.mcap")
    films = [str(path) for path in scene[1].values()]
    assert main(["calibrate", *films, "--output", str(tmp_path / "walk.yaml")]) == 2
    assert "that is another bag: name another --output" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["estimate", "{film}", "-o", "{dir}/a.mcap"], "films of two cameras or more are needed"),
        (["estimate", "{film}", "{dir}/none.mp4", "-o", "{dir}/a.mcap"], "no such file"),
        (["estimate", "{dir}", "-o", "{dir}/none/a.mcap"], "no such folder"),
        (["estimate", "a.mp4", "b.mp4", "-o", "{dir}/a.yaml"], "ends in .mcap"),
        (["calibrate", "{film}", "{dir}/a.mcap", "-o", "{dir}/a.yaml"], "a.mcap is no film; where"),
        (
            ["calibrate", "{dir}/a.mcap", "-o", "{dir}/a.yaml", "--fps-limit", "5"],
            "--fps-limit is for films",
        ),
        (
            ["calibrate", "rtsp://10.0.0.1/a", "{film}", "-o", "{dir}/a.yaml"],
            "is an address: record films first",
        ),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(
    arguments: list[str], problem: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    film = write_film(tmp_path / "cam0.mp4", range(3))
    assert main([text.format(film=film, dir=tmp_path) for text in arguments]) == 2
    said = capsys.readouterr().err
    assert problem in said
    assert said.count("\n") == 1


def test_a_rate_that_is_none_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["estimate", "a.mp4", "b.mp4", "-o", "a.mcap", "--fps-limit", "0"])
    assert "expected images a second from 0.1 to 1000, got '0'" in capsys.readouterr().err


def test_the_decoder_adds_nothing_to_the_message(tmp_path: Path) -> None:
    """In a process of its own: OpenCV reads once how much it is to print."""
    paths = [tmp_path / "a.mp4", tmp_path / "b.mp4"]
    for path in paths:
        path.write_text("not a film\n" * 100)
    command = [sys.executable, "-m", "stcalib_ros", "estimate", *map(str, paths), "-o", "a.mcap"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
