"""``stcalib place``, as a user runs it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from export_helpers import in_world

import stcalib_ros as st
from stcalib_ros.cli import main
from stcalib_ros.core.model.calibration import Status

SCENE = st.simulate(st.SceneOptions(n_cameras=3, n_people=1, n_frames=60))
RESULT = in_world(SCENE.truth)


@pytest.fixture
def result(tmp_path: Path) -> Path:
    st.write_result(RESULT, tmp_path / "walk.yaml")
    return tmp_path / "walk.yaml"


def at(*names: str) -> list[str]:
    """Arguments for the places that are meant: half a turn about the vertical, a metre aside."""
    poses = {camera.name: camera.t_ref_cam for camera in RESULT.cameras}
    return [f"{name}={1.0 - poses[name][0]:.6f},{-poses[name][1]:.6f}" for name in names]


def test_a_result_is_placed_and_can_be_used_as_before(
    result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "hall.yaml"
    places = at("cam0", "cam2")
    assert main(["place", str(result), "--at", *places, "-o", str(output), "--frame", "hall"]) == 0
    said = capsys.readouterr().out
    assert "0.000 m" in said
    assert f"Written to {output}: poses in the frame hall" in said
    placed = st.read_result(output)
    assert placed.frame_id == "hall"
    for before, after in zip(RESULT.cameras, placed.cameras, strict=True):
        expected = [1.0, 0.0, 0.0] + before.t_ref_cam * [-1.0, -1.0, 1.0]
        assert after.t_ref_cam == pytest.approx(expected, abs=1e-5)
    people = st.capture_people(SCENE.recording, placed).people
    same = st.capture_people(SCENE.recording, RESULT).people
    moved = [1.0, 0.0, 0.0] + same[0].joints_ref * [-1.0, -1.0, 1.0]
    assert np.nanmax(np.abs(people[0].joints_ref - moved)) < 1e-3


def test_json_has_what_is_printed(
    result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = str(tmp_path / "hall.yaml")
    assert main(["place", str(result), "--at", *at("cam0", "cam1"), "-o", output, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["written"] == output
    assert data["frame"] == "map"
    assert data["scale"] == 1.0
    assert list(data["misfits_m"]) == ["cam0", "cam1"]


@pytest.mark.parametrize(
    "wrong", ["cam0=1", "cam0=1,nan", "cam0=1,1e6", "=1,2", "cam0", "cam0=a,b"]
)
def test_what_is_no_place_is_said_with_an_example(
    wrong: str, result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["place", str(result), "-o", str(tmp_path / "out.yaml"), "--at", wrong, "cam1=2,3"])
    assert ended.value.code == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert "expected CAM=X,Y or CAM=X,Y,Z, as cam0=0.5,4.2" in said
    assert f"got '{wrong}'" in said


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["cam0=1,2", "cam0=2,3"], "--at: cam0 is given twice"),
        (["cam0=1,2", "cam7=2,3"], "--at: there is no camera cam7"),
        (["cam0=0,0", "cam1=90,0"], "--at: the cameras cannot be at these places"),
        (["cam0=0,0", "cam1=1,0", "--frame", ""], "--frame: expected a name"),
        (["cam0=0,0", "cam1=1,0", "--frame", "a\nb"], "printable characters"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(
    arguments: list[str],
    problem: str,
    result: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    output = tmp_path / "out.yaml"
    assert main(["place", str(result), "-o", str(output), "--at", *arguments]) == 2
    assert problem in capsys.readouterr().err.splitlines()[-1]
    assert not output.exists()


def test_refused_results_are_not_placed(result: Path, tmp_path: Path) -> None:
    st.write_result(replace(RESULT, status=Status.NOT_CONVERGED, message="no"), result)
    output = str(tmp_path / "hall.yaml")
    assert main(["place", str(result), "--at", *at("cam0", "cam2"), "-o", output]) == 3
