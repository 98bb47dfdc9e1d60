"""How predictions are compared with what a calibration finds."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.field import predictions
from benchmarks.field.case import Case, Member
from stcalib_ros.core.diagnosis.examine import CameraFit, Diagnosis
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.synthetic import SceneOptions, simulate

SCENE = simulate(SceneOptions(n_cameras=3, n_people=1, n_frames=30))
CASE = Case(SCENE.recording, (SCENE.truth,), {})


def stub(monkeypatch: pytest.MonkeyPatch, *, status: Status, n_found: int) -> None:
    """Have three cameras expected, the last one in doubt, and some of them calibrated."""
    names = tuple(camera.name for camera in SCENE.recording.cameras)
    said = Diagnosis((), calibrated=names, fits={names[2]: CameraFit(0.9, 0.6)})
    found = replace(SCENE.truth, status=status, cameras=SCENE.truth.cameras[:n_found])
    monkeypatch.setattr(predictions, "examine", lambda *_: said)
    monkeypatch.setattr(predictions, "calibrate", lambda *_: found)
    monkeypatch.setattr(predictions, "MEMBERS", (Member("A", "tiny", lambda _: CASE),))


def test_a_camera_in_doubt_that_is_left_out_counts(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stub(monkeypatch, status=Status.OK, n_found=2)
    assert predictions.main([]) == 0
    out = capsys.readouterr().out
    assert "said 3 (1 in doubt) -, found 2 -" in out
    assert "'will calibrate' was true 1 of 1 times (0 with just these cameras)" in out
    assert "1 cameras were left out of those expected, 1 of them in doubt; 0 in doubt" in out


def test_a_refusal_that_was_not_expected_counts(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stub(monkeypatch, status=Status.DEGENERATE, n_found=3)
    assert predictions.main(["--seeds", "2"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("! A  tiny")
    assert "'will calibrate' was true 0 of 2 times" in out
