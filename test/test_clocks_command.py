"""The commands of ``stcalib clocks``, run on videos whose images say which they are."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

import stcalib_ros as st
from stcalib_ros.cli import main
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.results import write_result

SIDE, BITS = 16, 8


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


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not installed")
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
    said = capsys.readouterr().out.splitlines()
    commands = [line for line in said if line.startswith("ffmpeg ")]
    for command in commands:
        subprocess.run([*shlex.split(command), "-loglevel", "error"], check=True)
    shown_s = [
        times[numbers(tmp_path / f"cam{c}_sync.mp4")] for c, times in enumerate(scene.exposures_s)
    ]
    late = [
        float(line.split("frames")[0].split()[-1])
        for line in said
        if line.startswith(("cam0", "cam1", "cam2"))
    ]
    n = min(map(len, shown_s))
    assert [len(shown) for shown in shown_s] == [n] * 3
    assert n > 60
    for c, rate_hz in enumerate(rates_hz):
        apart_s = shown_s[c][:n] - shown_s[0][:n]
        if rate_hz == rates_hz[0]:
            np.testing.assert_allclose(apart_s, late[c] / rate_hz, atol=2e-3)
        assert np.abs(apart_s).max() <= 1 / min(rate_hz, rates_hz[0])
