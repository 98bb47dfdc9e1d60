"""``stcalib draw``, as a user runs it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from film_helpers import write_film, write_scene_films

import stcalib_ros as st
from stcalib_ros.cli import main

SCENE = st.SceneOptions(n_cameras=3, n_people=2, n_frames=60, sigma_px=1.0, image_size=(640, 480))


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with result, bag and films."""
    folder = tmp_path_factory.mktemp("scene")
    write_scene_films(folder, SCENE)
    simulated = st.simulate(SCENE)
    st.write_bag(simulated.recording, folder / "walk.mcap")
    st.write_result(simulated.truth, folder / "walk.yaml")
    return folder


def drawn(scene: Path, output: Path, *options: str) -> int:
    """Exit status."""
    films = [str(scene / "cam0.mp4"), str(scene / "cam1.mp4"), str(scene / "cam2.mp4")]
    files = [str(scene / "walk.yaml"), str(scene / "walk.mcap")]
    return main(["draw", *files, "--films", *films, "--output", str(output), *options])


def test_a_picture_has_an_image_of_each_camera(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert drawn(scene, tmp_path / "a.png", "--at", "1.5") == 0
    picture = cv2.imread(str(tmp_path / "a.png"))
    assert picture is not None
    assert picture.shape[1] > 1000
    assert "3 cameras at 1.50 s are drawn" in capsys.readouterr().out


def test_undistorted_images_are_as_the_lenses_say(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert drawn(scene, tmp_path / "a.png", "--at", "1.5", "--undistort") == 0
    assert drawn(scene, tmp_path / "b.png", "--at", "1.5") == 0
    straight, plain = (cv2.imread(str(tmp_path / name)) for name in ("a.png", "b.png"))
    assert straight is not None
    assert plain is not None
    assert straight.shape == plain.shape
    assert np.median(np.abs(straight.astype(int) - plain.astype(int))) == 0  # no distortion
    result = st.read_result(scene / "walk.yaml")
    first = result.cameras[0]
    lens = replace(first.intrinsics, D=np.array([-0.2, 0.03, 0.0, 0.0, 0.0]))
    bent = replace(result, cameras=(replace(first, intrinsics=lens), *result.cameras[1:]))
    st.write_result(bent, tmp_path / "walk.yaml")
    files = [str(tmp_path / "walk.yaml"), str(scene / "walk.mcap"), "--films", str(scene)]
    output = ["--output", str(tmp_path / "a.mp4"), "--duration", "0.1", "--undistort"]
    assert main(["draw", *files, *output]) == 0
    film = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    assert film.read()[0]
    film.release()
    assert "3 cameras at 3 images" in capsys.readouterr().out


def test_a_film_has_the_images_of_its_duration(scene: Path, tmp_path: Path) -> None:
    assert drawn(scene, tmp_path / "a.mp4", "--at", "1", "--duration", "0.1") == 0
    film = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    n = sum(1 for _ in iter(film.grab, False))
    film.release()
    assert n == 3
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]


@pytest.mark.parametrize(
    ("name", "options", "problem"),
    [
        ("a.gif", [], "must end in .png, .jpg or .mp4"),
        ("none/a.png", [], "no such folder"),
        ("a.png", ["--at", "100"], "--at: expected 0 to"),
        ("a.png", ["--duration", "3"], "--duration is for films"),
        ("a.mp4", ["--duration", "-1"], "--duration: expected seconds"),
    ],
)
def test_what_cannot_be_drawn_is_said_in_one_line(
    name: str,
    options: list[str],
    problem: str,
    scene: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert drawn(scene, tmp_path / name, *options) == 2
    *warnings, said = capsys.readouterr().err.splitlines()
    assert problem in said
    assert all(line.startswith("stcalib: warning: ") for line in warnings)


def test_films_of_other_cameras_or_sizes_are_refused(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = [str(write_film(tmp_path / f"{name}.mp4", range(3))) for name in ("left", "right")]
    files = [str(scene / "walk.yaml"), str(scene / "walk.mcap")]
    output = ["--output", str(tmp_path / "a.png")]
    assert main(["draw", *files, "--films", *other, *output]) == 2
    assert "name them, as in cam0=left.mp4" in capsys.readouterr().err
    large = str(write_film(tmp_path / "large.mp4", range(3), size=(320, 480)))
    films = [f"cam0={large}", f"cam1={other[1]}"]
    assert main(["draw", *files, "--films", *films, *output]) == 2
    assert "give the film that was calibrated" in capsys.readouterr().err
