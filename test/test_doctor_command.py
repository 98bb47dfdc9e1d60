"""``stcalib doctor``: what it prints, and how it ends."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import pose_writers
import pytest
from core_helpers import SMALL, changed, clock_shifted

import stcalib_ros
from stcalib_ros.cli import main
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.synthetic import simulate
from stcalib_ros.io.bag_writer import write_bag

DEMO = Path(stcalib_ros.__file__).parent / "data" / "demo" / "balance.mcap"
WIDTH = 80


def bag(folder: Path, recording: Recording) -> str:
    write_bag(recording, folder / "walk.mcap")
    return str(folder / "walk.mcap")


@cache
def recorded() -> Recording:
    return simulate(replace(SMALL, n_frames=150)).recording


def test_the_demo_will_calibrate_and_its_tables_fit_a_terminal(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["doctor", str(DEMO)]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "4 cameras, 2.2 s, 400 images" in out
    assert "Prediction: will calibrate, 4 of 4 cameras" in out
    assert max(map(len, out.splitlines()[2:])) <= WIDTH


def test_json_has_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", bag(tmp_path, recorded()), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["will_calibrate"] is True
    assert found["calibrated"] == ["cam0", "cam1", "cam2"]
    assert found["doubtful"] == []
    assert [camera["layout"] for camera in found["cameras"]] == ["h36m_17"] * 3
    assert len(found["pairs"]) == 3
    assert found["cameras"][0]["lens"] == "given"
    assert set(found["fits"]["cam1"]) == {"fitting", "explained"}
    assert [one["code"] for one in found["advice"]] == ["RECORD_LONGER"]


def test_what_will_not_calibrate_ends_with_3_and_the_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = changed(recorded(), "cam1", clock_shifted(3600.0))
    two = Recording(recording.cameras[:2], recording.epoch_ns)
    path = bag(tmp_path, two)
    assert main(["doctor", path]) == 0  # clocks that share no time are aligned by their starts
    capsys.readouterr()
    assert main(["doctor", path, "--align", "stamps"]) == 3
    out, err = capsys.readouterr()
    assert "stcalib: Prediction: will NOT calibrate. TOO_FEW_CAMERAS" in err
    assert "Left out:" in out
    assert "CLOCK_EPOCH_DIFFERS" in out
    assert main(["doctor", path, "--align", "stamps", "--json"]) == 3
    found = json.loads(capsys.readouterr().out)
    assert found["will_calibrate"] is False
    assert found["reasons"][0]["code"] == "TOO_FEW_CAMERAS"


def test_a_camera_that_is_in_doubt_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = changed(recorded(), "cam1", lambda c: replace(c, tracks=c.tracks[:1]))
    path = bag(tmp_path, Recording(recording.cameras[:2], recording.epoch_ns))
    assert main(["doctor", path]) == 0
    assert "In doubt:\n- cam0: " in capsys.readouterr().out


def test_options_are_those_of_calibrate(tmp_path: Path) -> None:
    recording = changed(recorded(), "cam1", clock_shifted(12.0))
    path = bag(tmp_path, Recording(recording.cameras[:2], recording.epoch_ns))
    assert main(["doctor", path, "--align", "stamps"]) == 3
    assert main(["doctor", path, "--align", "stamps", "--offset-range", "7"]) == 0


def test_unknown_lenses_are_unusable_until_they_are_to_be_estimated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(tmp_path / "walk.mcap")
    truth = str(tmp_path / "truth.yaml")
    size = ["--n-cameras", "2", "--n-people", "1", "--n-frames", "90"]
    assert main(["simulate", path, "--truth", truth, "--unknown-lenses", *size]) == 0
    capsys.readouterr()
    assert main(["doctor", path]) == 2
    out, err = capsys.readouterr()
    assert "cam0    90 " in out
    assert "missing" in out
    assert "--intrinsics" in err
    main(["doctor", path, "--intrinsics", "unknown"])
    assert "missing" not in capsys.readouterr().out


@pytest.mark.parametrize("name", ["nothing.mcap", "."])
def test_what_is_no_bag_ends_with_2(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["doctor", str(tmp_path / name)]) == 2
    assert capsys.readouterr().err.startswith("stcalib: ")


@pytest.mark.parametrize(
    ("write", "arguments", "said"),
    [
        (pose_writers.openpose, ["--fps", "30", "--image-size", "1920x1080"], "openpose"),
        (pose_writers.caliscope, [], "caliscope"),
        (lambda root, n: pose_writers.multi_view_npz(root.with_suffix(".npz"), n), [], "npz"),
    ],
)
def test_poses_of_other_programs_are_examined_as_convert_reads_them(
    write: Callable[[Path, int], Path],
    arguments: list[str],
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    source = write(tmp_path / "source", 90)
    assert main(["doctor", str(source), *arguments]) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"{source}, read as {said}: 3 cameras, ")
    assert "will calibrate, 3 of 3 cameras" in " ".join(out.split())


def test_what_convert_needs_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = str(pose_writers.openpose(tmp_path / "op", 2))
    for arguments, said in (
        ([source], "give --fps HZ"),
        ([source, "--fps", "30"], "give --image-size"),
        ([source, "--format", "x"], "--format x: there are npz, pose2sim"),
        ([str(DEMO), "--fps", "30"], "--fps is for poses in the files of other programs, but "),
    ):
        assert main(["doctor", *arguments]) == 2
        assert said in capsys.readouterr().err


def test_what_is_not_there_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "nowhere", "--fps", "30"]) == 2
    assert capsys.readouterr().err == "stcalib: no such file or folder: nowhere\n"
