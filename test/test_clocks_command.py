"""The commands of ``stcalib clocks``, run on videos whose images say which they are."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import stcalib_ros as st
from stcalib_ros.cli import main
from stcalib_ros.core.model.recording import CameraRecording, only_images
from stcalib_ros.io.bag_origin import film_key
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.convert_options import ConvertOptions
from stcalib_ros.io.film_files import film_id
from stcalib_ros.io.results import write_result

SIDE, BITS = 16, 8
FILM_START_S = ConvertOptions().start_s


def write_numbered(path: Path, n: int, rate_hz: float) -> None:
    """A video whose image k has k in black and white squares, as binary digits."""
    video = cv2.VideoWriter(
        str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate_hz, (SIDE * BITS, 2 * SIDE)
    )
    assert video.isOpened()
    for k in range(n):
        bits = [255 * (k >> b & 1) for b in range(BITS)]
        row = np.repeat(np.array(bits, np.uint8), SIDE)
        video.write(np.repeat(np.tile(row, (2 * SIDE, 1))[..., None], 3, axis=2))
    video.release()


def numbers(path: Path) -> list[int]:
    """Numbers of the images of such a video."""
    video, out = cv2.VideoCapture(str(path)), []
    while (image := video.read()[1]) is not None:
        bits = image[SIDE, SIDE // 2 :: SIDE, 0] > 127
        out.append(int(sum(1 << b for b in range(BITS) if bits[b])))
    return out


needs_ffmpeg = pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not installed")


def run_commands(said: str) -> None:
    for line in said.splitlines():
        if line.startswith("ffmpeg "):
            subprocess.run([*shlex.split(line), "-loglevel", "error"], check=True)


def shown(scene: st.Scene) -> list[np.ndarray]:
    """True times of the images of what was cut, by camera."""
    return [times[numbers(Path(f"cam{c}_sync.mp4"))] for c, times in enumerate(scene.exposures_s)]


def with_images(camera: CameraRecording, which: slice) -> CameraRecording:
    used = np.zeros(len(camera.stamps), bool)
    used[which] = True
    return only_images(camera, used)


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> st.Scene:
    """Two cameras of 30 Hz with their videos and true values in the working directory."""
    monkeypatch.chdir(tmp_path)
    scene = st.simulate(st.SceneOptions(n_cameras=2, n_people=1, n_frames=90, fps=30.0, seed=4))
    write_result(scene.truth, Path("walk.yaml"))
    for camera in scene.recording.cameras:
        write_numbered(Path(f"{camera.name}.mp4"), len(camera.stamps), 30.0)
    return scene


@needs_ffmpeg
@pytest.mark.parametrize("which", [slice(None, None, 3), slice(0, 60)])
def test_videos_have_frames_that_the_bag_lacks(
    scene: st.Scene, which: slice, capsys: pytest.CaptureFixture[str]
) -> None:
    a, b = scene.recording.cameras
    write_bag(replace(scene.recording, cameras=(with_images(a, which), b)), Path("walk.mcap"))
    assert main(["clocks", "walk.yaml", "walk.mcap"]) == 0
    out, err = capsys.readouterr()
    run_commands(out)
    one, other = shown(scene)
    assert len(one) == len(other) > 70
    assert np.abs(one - other).max() < 0.6 / 30
    is_short = which.stop == 60
    assert ("cam0.mp4 is 1.00 s longer than the images of cam0 in the bag" in err) == is_short


@needs_ffmpeg
@pytest.mark.parametrize("is_of_films", [False, True])
def test_a_bag_that_lacks_the_first_images_of_a_camera(
    scene: st.Scene, capsys: pytest.CaptureFixture[str], is_of_films: bool
) -> None:
    videos = {camera.name: Path(f"{camera.name}.mp4") for camera in scene.recording.cameras}
    shifts_s = {
        camera.name: FILM_START_S - scene.recording.epoch_ns * 1e-9 - float(camera.stamps[0])
        for camera in scene.recording.cameras
    }
    cameras = [
        replace(camera, stamps=camera.stamps + shifts_s[camera.name])
        for camera in scene.recording.cameras
    ]
    cameras[1] = with_images(cameras[1], slice(25, None))
    truth = replace(
        scene.truth,
        cameras=tuple(
            replace(one, time_offset_s=one.time_offset_s - shifts_s[one.name] + shifts_s["cam0"])
            for one in scene.truth.cameras
        ),
    )
    write_result(truth, Path("walk.yaml"))
    origin = {film_key(name): film_id(path) for name, path in videos.items()}
    write_bag(
        replace(scene.recording, cameras=tuple(cameras)),
        Path("walk.mcap"),
        origin=origin if is_of_films else None,
    )
    said = [] if is_of_films else ["--bag-begins", f"cam1={25 / 30:.4f}"]
    assert main(["clocks", "walk.yaml", "walk.mcap", *said]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    run_commands(out)
    one, other = shown(scene)
    assert len(one) == len(other) > 80
    assert np.abs(one - other).max() < 0.6 / 30


def test_videos_that_are_not_there_are_named(
    scene: st.Scene, capsys: pytest.CaptureFixture[str]
) -> None:
    write_bag(scene.recording, Path("walk.mcap"))
    Path("cam1.mp4").unlink()
    assert main(["clocks", "walk.yaml", "walk.mcap"]) == 0
    assert "not here: cam1.mp4; the images of the bag are taken as" in capsys.readouterr().err
    assert main(["clocks", "walk.yaml", "walk.mcap", "--bag-begins", "cam1=0.5"]) == 2
    assert "no such file: cam1.mp4; name the video with" in capsys.readouterr().err
    assert main(["clocks", "walk.yaml", "walk.mcap", "--bag-begins", "cam7=0.5"]) == 2
    assert "no such camera in walk.yaml; there are cam0, cam1" in capsys.readouterr().err


@needs_ffmpeg
@pytest.mark.parametrize("rates_hz", [(30.0, 30.0, 30.0), (30.0, 25.0, 50.0)])
def test_the_same_moment_is_in_the_same_image_of_what_is_cut(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    rates_hz: tuple[float, ...],
) -> None:
    monkeypatch.chdir(tmp_path)
    scene = st.simulate(st.SceneOptions(n_cameras=3, n_people=1, n_frames=90, fps=rates_hz, seed=4))
    write_bag(scene.recording, tmp_path / "walk.mcap")
    write_result(scene.truth, tmp_path / "walk.yaml")
    for camera, rate_hz in zip(scene.recording.cameras, rates_hz, strict=True):
        write_numbered(tmp_path / f"{camera.name}.mp4", len(camera.stamps), rate_hz)
    assert main(["clocks", "walk.yaml", "walk.mcap"]) == 0
    out = capsys.readouterr().out
    run_commands(out)
    shown_s = shown(scene)
    late = [
        float(line.split("frames")[0].split()[-1])
        for line in out.splitlines()
        if line.startswith(("cam0", "cam1", "cam2"))
    ]
    n = min(map(len, shown_s))
    assert list(map(len, shown_s)) == [n] * 3
    assert n > 60
    for c, rate_hz in enumerate(rates_hz):
        apart_s = shown_s[c][:n] - shown_s[0][:n]
        if rate_hz == rates_hz[0]:
            np.testing.assert_allclose(apart_s, late[c] / rate_hz, atol=2e-3)
        assert np.abs(apart_s).max() <= 1 / min(rate_hz, rates_hz[0])
