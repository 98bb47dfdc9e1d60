"""The command on recordings that can, and that cannot, be calibrated."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import pytest

from stcalib_ros.cli import main
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.core.types import Recording, Status
from stcalib_ros.io.bag_writer import write_recording
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
    write_recording(make(), tmp_path / "bag.mcap")
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
    write_recording(recording(), tmp_path / "bag.mcap")
    output = str(tmp_path / "out.yaml")
    arguments = ["calibrate", str(tmp_path / "bag.mcap"), "-o", output, "-q"]
    assert main([*arguments, "--reference", "cam9"]) == 2
    assert "cam9" in capsys.readouterr().err


def test_the_others_are_calibrated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A fourth camera that watches other people is reported, not guessed."""
    here, elsewhere = recording(), recording(seed=77, n_cameras=4)
    stranger = elsewhere.cameras[3]
    mixed = dataclasses.replace(here, cameras=(*here.cameras, stranger))
    write_recording(mixed, tmp_path / "bag.mcap")
    output = tmp_path / "out.yaml"
    assert main(["calibrate", str(tmp_path / "bag.mcap"), "-o", str(output)]) == 0
    result = read_result(output)
    assert [c.name for c in result.cameras] == ["cam0", "cam1", "cam2"]
    assert [c.name for c in result.uncalibrated] == ["cam3"]
    assert f"NOT calibrated: cam3: {result.uncalibrated[0].reason}" in capsys.readouterr().out


def test_the_number_of_processes_does_not_change_the_result(tmp_path: Path) -> None:
    write_recording(recording(), tmp_path / "bag.mcap")
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
