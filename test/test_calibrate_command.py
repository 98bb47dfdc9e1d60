"""The command on recordings that can, and that cannot, be calibrated."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import pytest

from stcalib_ros.cli import main
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.mocap import shipped_clips
from stcalib_ros.io.results import read_result

USUAL = SceneOptions(n_cameras=3, n_people=2, n_frames=150, max_offset_frames=5, seed=2)


def recording(**changes: object) -> Recording:
    return simulate(dataclasses.replace(USUAL, **changes), clips=shipped_clips()).recording


def one_camera() -> Recording:
    return recording(n_cameras=1)


def clocks_apart() -> Recording:
    whole = recording(n_cameras=2)
    late = dataclasses.replace(whole.cameras[1], stamps=whole.cameras[1].stamps + 100.0)
    return dataclasses.replace(whole, cameras=(whole.cameras[0], late))


def few_frames() -> Recording:
    return recording(n_frames=10)


def nobody_moves() -> Recording:
    return recording(people="standing")


def nobody_there() -> Recording:
    whole = recording()
    cameras = tuple(dataclasses.replace(camera, tracks=()) for camera in whole.cameras)
    return dataclasses.replace(whole, cameras=cameras)


@pytest.mark.parametrize("make", [one_camera, clocks_apart, few_frames, nobody_moves, nobody_there])
def test_no_calibration_can_be_had(
    tmp_path: Path, make: Callable[[], Recording], capsys: pytest.CaptureFixture[str]
) -> None:
    write_bag(make(), tmp_path / "bag.mcap")
    output = tmp_path / "out.yaml"
    assert main(["calibrate", str(tmp_path / "bag.mcap"), "-o", str(output), "-q"]) in (2, 3)
    out, err = capsys.readouterr()
    assert out == ""
    lines = [line for line in err.splitlines() if not line.startswith("stcalib: warning: ")]
    assert len(lines) == 1
    assert lines[0].startswith("stcalib: ")
    assert not output.exists()
    rejected = tmp_path / "out.rejected.yaml"
    if rejected.exists():
        assert read_result(rejected).status is not Status.OK


def test_unknown_reference(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_bag(recording(), tmp_path / "bag.mcap")
    output = str(tmp_path / "out.yaml")
    arguments = ["calibrate", str(tmp_path / "bag.mcap"), "-o", output, "-q"]
    assert main([*arguments, "--reference", "cam9"]) == 2
    assert "cam9" in capsys.readouterr().err


def test_the_others_are_calibrated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A fourth camera that watches other people is reported, not guessed."""
    here, elsewhere = recording(), recording(seed=77, n_cameras=4)
    stranger = elsewhere.cameras[3]
    mixed = dataclasses.replace(here, cameras=(*here.cameras, stranger))
    write_bag(mixed, tmp_path / "bag.mcap")
    output = tmp_path / "out.yaml"
    assert main(["calibrate", str(tmp_path / "bag.mcap"), "-o", str(output)]) == 0
    result = read_result(output)
    assert [c.name for c in result.cameras] == ["cam0", "cam1", "cam2"]
    assert [c.name for c in result.uncalibrated] == ["cam3"]
    out = " ".join(capsys.readouterr().out.split())
    assert f"NOT calibrated: cam3: {result.uncalibrated[0].reason}" in out


def test_line_times(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One is given, all are estimated; on the command line, in the text and in the result."""
    rolling = recording(n_frames=200, line_time_s=(25e-6, 0.0, 25e-6), seed=3, n_people=3)
    write_bag(rolling, tmp_path / "bag.mcap")
    (tmp_path / "c.yaml").write_text("camera: {cam0: {line_time_s: 25e-6}, cam2: {frame: lens}}")
    output = tmp_path / "out.yaml"
    arguments = ["calibrate", str(tmp_path / "bag.mcap"), "-o", str(output)]
    arguments += ["-c", str(tmp_path / "c.yaml"), "--line-time", "cam2=25e-6"]
    assert main(arguments) == 0
    given = read_result(output)
    assert [c.line_time_s for c in given.cameras] == [25e-6, 0.0, 25e-6]
    assert given.cameras[2].frame_id == "lens"
    assert "reference, 25.00 us per row\n" in capsys.readouterr().out
    assert main([*arguments, "--estimate-line-time"]) == 0
    for camera, line_s in zip(read_result(output).cameras, [25e-6, 0.0, 25e-6], strict=True):
        assert abs(camera.line_time_s - line_s) < 4.0 * camera.line_time_stddev_s < 2e-5
    assert capsys.readouterr().out.count("us per row") == 3


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("cam0", "expected CAM=SECONDS, got 'cam0'"),
        ("cam0=fast", "expected seconds per image row after cam0=, got 'fast'"),
    ],
)
def test_line_times_that_are_none(
    given: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        main(["calibrate", "walk.mcap", "-o", "walk.yaml", "--line-time", given])
    assert end.value.code == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("cam9=1e-5", "line_time_s of camera cam9: there are no person poses"),
        ("cam1=-1e-6", "camera cam1: line_time_s must be at least 0"),
        ("cam1=nan", "camera cam1: line_time_s must be at least 0"),
        ("cam1=25e-3", "camera cam1: line_time_s 0.025 makes"),
    ],
)
def test_unusable_line_times(
    tmp_path: Path, given: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    write_bag(recording(n_frames=20), tmp_path / "bag.mcap")
    arguments = ["calibrate", str(tmp_path / "bag.mcap"), "-q", "-o", str(tmp_path / "out.yaml")]
    assert main([*arguments, "--line-time", given]) == 2
    assert message in capsys.readouterr().err


def test_the_number_of_processes_does_not_change_the_result(tmp_path: Path) -> None:
    write_bag(recording(), tmp_path / "bag.mcap")
    arguments = ["calibrate", str(tmp_path / "bag.mcap"), "-q", "-o"]
    for jobs in ("1", "2"):
        assert main([*arguments, str(tmp_path / f"{jobs}.yaml"), "--jobs", jobs]) == 0
    assert (tmp_path / "1.yaml").read_text() == (tmp_path / "2.yaml").read_text()


@pytest.mark.parametrize("jobs", ["0", "-1", "two", "1.5"])
def test_processes_are_counted(jobs: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["calibrate", "walk.mcap", "-o", "walk.yaml", "--jobs", jobs])
    assert end.value.code == 2
    assert "expected a whole number of at least 1" in capsys.readouterr().err
