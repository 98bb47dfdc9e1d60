"""The table of what a calibration makes of the film, with a stand-in for the command."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.film import level
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.io.results import read_result, write_result

_FOLDER = Path(__file__).parents[3] / "examples" / "film"


def _stand_in(monkeypatch: pytest.MonkeyPatch, *, error_rad: float, status: int = 0) -> list[str]:
    """Let `stcalib calibrate` give the truth with rotations that are so much off."""
    said: list[str] = []

    def run(command: Sequence[str], **_: Any) -> subprocess.CompletedProcess[str]:
        said.extend(command)
        n = sum(word.endswith(".mp4") for word in command)
        cameras = read_result(_FOLDER / "truth.yaml").cameras[:n]
        R = exp_so3(np.array([error_rad, 0.0, 0.0]))
        turned = [replace(camera, R_ref_cam=R @ camera.R_ref_cam) for camera in cameras[1:]]
        result = replace(read_result(_FOLDER / "truth.yaml"), cameras=(cameras[0], *turned))
        write_result(result, Path(command[-1]))
        return subprocess.CompletedProcess(command, status, "", "a line\nno people\n")

    monkeypatch.setattr(level.subprocess, "run", run)
    monkeypatch.setattr(level, "read_bag", lambda _: Recording(()))
    return said


_ARGUMENTS = ["--folder", str(_FOLDER), "--cameras", "4", "--intrinsics", "given"]


@pytest.mark.parametrize(("error_rad", "status"), [(0.009, 0), (0.011, 1)])
def test_errors_beside_their_targets(
    error_rad: float,
    status: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    said = _stand_in(monkeypatch, error_rad=error_rad)
    assert level.main(_ARGUMENTS) == status
    printed = capsys.readouterr().out
    assert f"E_R            {error_rad:.4f} rad" in printed
    assert sum(word.endswith(".mp4") for word in said) == 4
    assert not {"--line-time", "--estimate-line-time"} & set(said)


def test_the_rolling_shutter_is_given_or_estimated_if_asked(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said = _stand_in(monkeypatch, error_rad=0.0)
    assert level.main([*_ARGUMENTS, "--line-delay", "given", "estimated"]) == 0
    assert said.count("--output") == 2
    assert said[said.index("--line-time") + 1] == "cam3=5e-05"
    assert said.count("--estimate-line-time") == 1
    printed = capsys.readouterr().out
    assert "line delay given" in printed
    assert "line delay estimated" in printed


def test_what_the_command_says_when_it_fails(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _stand_in(monkeypatch, error_rad=0.0, status=3)
    assert level.main(_ARGUMENTS) == 1
    assert "no people" in capsys.readouterr().out
