"""The benchmark of the watch on short scenes, with the true calibration in force."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.live import watch, watched_scenes
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.synthetic import SceneOptions, simulate


@pytest.fixture(autouse=True)
def true_calibration(monkeypatch):
    monkeypatch.setattr(watched_scenes, "_calibration", without_rates)
    for module in (watch, watched_scenes):
        monkeypatch.setattr(module, "CALIBRATED_S", 2.0)
    monkeypatch.setattr(watch, "QUIET_S", 4.0)


def without_rates(scene):
    cameras = tuple(replace(c, clock_skew=0.0) for c in scene.truth.cameras)
    return replace(scene.truth, cameras=cameras)


def test_a_turn_and_a_jump_are_noticed(capsys):
    assert watch.main(["--only", "turn", "--runs", "1", "--cameras", "3"]) == 0
    assert watch.main(["--only", "days", "--runs", "1", "--cameras", "3", "--json"]) == 0
    said = capsys.readouterr()
    assert "turn, 3 cameras: one of them turns by 2 degrees" in said.out
    assert "right alarm    1 of 1" in said.out
    (found,) = json.loads(said.out[said.out.index("[\n") :])
    assert found["detected_s"] <= watch.WITHIN_S
    assert "the clock of cam0 has jumped" in found["sentence"]
    assert "false alarms   in 0 of 1" in said.err


def test_undisturbed_walking_raises_no_alarm(capsys):
    given = ["--only", "undisturbed", "--runs", "1", "--minutes", "0.2", "--cameras", "2"]
    assert watch.main(given) == 0
    assert "false alarms   in 0 of 1" in capsys.readouterr().out


def test_a_drift_is_said_as_one(monkeypatch, capsys):
    monkeypatch.setattr(watch, "DRIFT_SPANS", 18)
    monkeypatch.setattr(watch, "DRIFT_PAUSE_S", 240.0)
    assert watch.main(["--only", "drift", "--runs", "1", "--cameras", "3", "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)
    assert 0.04 <= found["detected_s"] <= watch.MAX_DRIFT_S
    assert "has drifted by" in found["sentence"]


def test_a_scene_that_is_refused_is_replaced_by_the_next(monkeypatch, capsys):
    def refused(scene):
        wanted = Status.DEGENERATE if scene.options.seed < 30_100 else Status.OK
        return replace(without_rates(scene), status=wanted, message="too little")

    monkeypatch.setattr(watched_scenes, "_calibration", refused)
    given = ["--only", "undisturbed", "--runs", "1", "--minutes", "0.1", "--cameras", "3"]
    assert watch.main(given) == 0
    assert "calibrated     1 of 1, 1 scenes refused before" in capsys.readouterr().out
    monkeypatch.setattr(watched_scenes, "ATTEMPTS", 1)
    assert watch.main(given) == 1
    said = capsys.readouterr().out
    assert "calibrated     0 of 1" in said
    assert "not calibrated: too little" in said


def test_the_same_people_are_recorded_later_as_the_clocks_run():
    rates = {"cam1": 2e-5}
    recording = simulate(SceneOptions(n_cameras=2, n_frames=30, max_offset_frames=0)).recording
    after = watched_scenes.later(recording, rates, 86_400.0)
    assert after.epoch_ns == recording.epoch_ns + 86_400 * 10**9
    still, behind = (
        one.stamps - other.stamps
        for one, other in zip(after.cameras, recording.cameras, strict=True)
    )
    np.testing.assert_array_equal(still, 0.0)
    np.testing.assert_allclose(behind, -1.728, atol=1e-4)


def test_figures_are_held_to_their_targets():
    good = watch.Run("turn", 1, "bias", "cam1", detected_s=4.0, checked_s=20.0, cpu_s=0.5)
    late = replace(good, detected_s=11.0)
    false = replace(good, false_alarms=("12 s: cam0 has moved",), cpu_s=5.0)
    met = {row.figure: row.met for row in watch.summary("turn", [good, good])}
    assert all(value is not False for value in met.values())
    missed = [row.figure for row in watch.summary("turn", [good, late, false]) if row.met is False]
    assert missed == ["right alarm", "false alarms"]
    costs = watch.summary("cost", [false])
    assert [row.figure for row in costs if row.met is False] == ["false alarms", "CPU"]
