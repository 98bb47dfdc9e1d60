"""The benchmark of the watch on short scenes, with the true calibration in force."""

import json
from dataclasses import replace

import pytest

from benchmarks.live import watch
from stcalib_ros.core.model.calibration import Status


@pytest.fixture(autouse=True)
def true_calibration(monkeypatch):
    monkeypatch.setattr(watch, "_calibration", lambda scene: scene.truth)
    monkeypatch.setattr(watch, "CALIBRATED_S", (0.0,))
    monkeypatch.setattr(watch, "QUIET_S", 4.0)


def test_a_turn_and_a_jump_are_noticed(capsys):
    assert watch.main(["--only", "turn", "--runs", "1"]) == 0
    assert watch.main(["--only", "clock", "--runs", "1", "--json"]) == 0
    said = capsys.readouterr()
    assert "right alarm    1 of 1" in said.out
    (found,) = json.loads(said.out[said.out.index("[\n") :])
    assert found["detected_s"] <= watch.WITHIN_S
    assert "the clock of cam0 has jumped" in found["sentence"]
    assert "false alarms   in 0 of 1" in said.err


def test_undisturbed_walking_raises_no_alarm(capsys):
    assert watch.main(["--only", "undisturbed", "--runs", "1", "--minutes", "0.2"]) == 0
    assert "false alarms   in 0 of 1" in capsys.readouterr().out


def test_a_scene_that_is_not_calibrated_is_a_miss(monkeypatch, capsys):
    def refused(scene):
        return replace(scene.truth, status=Status.DEGENERATE, message="too little")

    monkeypatch.setattr(watch, "_calibration", refused)
    assert watch.main(["--only", "turn", "--runs", "1"]) == 1
    said = capsys.readouterr().out
    assert "calibrated     0 of 1" in said
    assert "not calibrated: too little" in said


def test_figures_are_held_to_their_targets():
    good = watch.Run("turn", 1, "bias", "cam1", detected_s=4.0, checked_s=20.0, cpu_s=0.5)
    late = replace(good, detected_s=11.0)
    false = replace(good, false_alarms=("12 s: cam0 has moved",), cpu_s=5.0)
    met = {row.figure: row.met for row in watch.summary("turn", [good, good])}
    assert all(value is not False for value in met.values())
    missed = [row.figure for row in watch.summary("turn", [good, late, false]) if row.met is False]
    assert missed == ["right alarm", "false alarms", "CPU"]
