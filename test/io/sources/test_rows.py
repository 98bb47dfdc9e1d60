"""The table of docs/formats.md: the two commands of each row are what such a source needs."""

from __future__ import annotations

import random
import re
import shlex
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pose_writers as writers
import pytest
from pose_files import FPS, N_FRAMES, OPTIONS, scene
from scipy.spatial.transform import Rotation

import stcalib_ros as st
from stcalib_ros.cli import main
from stcalib_ros.io.results import read_result
from stcalib_ros.io.sources import SOURCES

PAGE = Path(__file__).parents[3] / "docs" / "formats.md"
ROW = re.compile(
    r"\| `(\w+)` \| [^|]+ \| `stcalib (convert [^`]+)`<br>`stcalib (calibrate [^`]+)` \|$"
)
ROWS = {m[1]: (m[2], m[3]) for line in PAGE.read_text().splitlines() if (m := ROW.search(line))}


def freemocap(root: Path, n: int) -> Path:
    writers.freemocap(root, n)
    for c in range(3):
        video = root / "synchronized_videos" / f"cam_{c}.mp4"
        writers.write_video(video, (1920, 1080), 30.0)
    return root


CAMERAS = ["cam01", "cam02", "cam03"]
WRITERS: Mapping[str, Callable[[Path, int], Path]] = {
    "openpose": writers.openpose,
    "alphapose": lambda root, n: writers.alphapose(root, n, tracked=True),
    "mmpose": lambda root, n: writers.mmpose_videos(root, n, described=True),
    "coco": lambda root, n: writers.coco_annotations(root.with_suffix(".json"), n),
    "ultralytics": lambda root, n: writers.ultralytics(root, "conf id", n),
    "mediapipe": writers.mediapipe_arrays,
    "pose2sim": lambda root, n: writers.pose2sim(root, n, names=CAMERAS, rate="30"),
    "caliscope": writers.caliscope,
    "easymocap_2d": lambda root, n: writers.easymocap_2d(root, n, lenses=True),
    "freemocap": freemocap,
    "npz": lambda root, n: writers.multi_view_npz(root.with_suffix(".npz"), n),
}


def test_every_format_has_its_row_and_is_written_here() -> None:
    assert set(ROWS) == {*SOURCES, "npz"} == set(WRITERS)


@pytest.mark.parametrize("name", ROWS)
def test_the_two_commands_of_a_row_calibrate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """The first one is enough, and says the second; the cameras began at different times."""
    monkeypatch.chdir(tmp_path)
    first, second = ROWS[name]
    source = WRITERS[name](tmp_path / "source", N_FRAMES)
    assert main([str(source) if w == "SOURCE" else w for w in shlex.split(first)]) == 0
    said = capsys.readouterr().out
    assert f"Read as {name}:" in said
    assert said.endswith(f"Next: stcalib {second}\n")
    assert main(shlex.split(second)) == 0, capsys.readouterr().err
    assert_true(read_result(Path("walk.yaml")), writers.LATE_S if name == "caliscope" else 0.0)


def assert_true(found: st.Calibration, late_s: float) -> None:
    """Compare with the scene, in any unit; the clock of camera c is ahead by c times late_s."""
    simulated = st.simulate(OPTIONS)
    begun_s = [float(times[0]) for times in simulated.exposures_s]
    assert max(begun_s) - min(begun_s) > 5 / FPS, "the cameras of the scene are not synchronous"
    assert len(found.cameras) == len(scene().cameras)
    lengths = [np.linalg.norm(of.cameras[1].t_ref_cam) for of in (found, simulated.truth)]
    for c, (own, true) in enumerate(zip(found.cameras, simulated.truth.cameras, strict=True)):
        turned = Rotation.from_matrix(own.R_ref_cam.T @ true.R_ref_cam).magnitude()
        assert np.degrees(turned) < 0.5
        moved = own.t_ref_cam / lengths[0] - true.t_ref_cam / lengths[1]
        assert np.linalg.norm(moved) < 0.03
        assert own.time_offset_s + late_s * c == pytest.approx(begun_s[c] - begun_s[0], abs=2e-3)


@pytest.mark.parametrize("name", SOURCES)
def test_damaged_files_are_an_error_of_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """A file is cut, or a number in it becomes something else; no exception gets out."""
    source = WRITERS[name](tmp_path / "source", writers.N)
    files = [source] if source.is_file() else sorted(f for f in source.rglob("*") if f.is_file())
    files = [file for file in files if file.suffix != ".mp4"]
    rng = random.Random(name)
    for _ in range(6):
        file = rng.choice(files)
        whole = file.read_bytes()
        at = rng.randrange(len(whole))
        other = rng.choice([b"", b"-1e999", b"null", b"[", b"9" * 30, b"\xff"])
        file.write_bytes(whole[:at] + (other + whole[at + 1 :] if rng.random() < 0.7 else b""))
        arguments = ["--fps", "30", "--image-size", "1920x1080", "--format", name]
        assert main(["convert", str(source), str(tmp_path / "o.mcap"), *arguments]) in (0, 2)
        assert capsys.readouterr().err.count("\n") <= 1
        file.write_bytes(whole)
