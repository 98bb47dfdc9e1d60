"""The benchmark's own arithmetic, with a calibration that is played."""

import json
from dataclasses import replace
from fractions import Fraction

import pytest

from benchmarks import level, measure
from benchmarks.scenarios import SCENARIOS, Scenario
from stcalib_ros.core.errors import CalibrationError
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.core.types import Status, UncalibratedCamera

SCENARIO = Scenario(
    "short", "a short scene", SceneOptions(n_frames=20), 3, Fraction(2, 3), {"E_R": 0.001}
)


@pytest.fixture
def play(monkeypatch):
    """Let the calibration return what a function makes of the truth."""

    def play_with(answer):
        truths = []

        def simulated(*args, **kwargs):
            scene = simulate(*args, **kwargs)
            truths.append(scene.truth)
            return scene

        monkeypatch.setattr(measure, "simulate", simulated)
        monkeypatch.setattr(measure, "calibrate", lambda *_: answer(truths[-1]))

    return play_with


def section(n_scenes=3):
    return level.summary(SCENARIO, [measure.run_scene(SCENARIO, k) for k in range(n_scenes)])


def verdicts(rows):
    return {row.figure: row.met for row in rows}


def test_a_perfect_calibration_meets_the_level(play):
    play(lambda truth: truth)
    found = section()
    assert verdicts(found.rows)["solved"] is True
    assert verdicts(found.rows)["E_R"] is True
    assert verdicts(found.rows)["E_t"] is None
    assert found.notes == ()


def test_refusals_count_as_not_solved(play):
    def refuse(_):
        raise CalibrationError("nobody moves")

    play(refuse)
    found = section()
    assert verdicts(found.rows)["solved"] is False
    assert verdicts(found.rows)["E_R"] is False
    assert found.notes[0] == "seed 0: nobody moves"


def test_a_missing_camera_and_a_bad_status_count_as_not_solved(play):
    def partly(truth):
        return replace(
            truth,
            status=Status.DEGENERATE,
            message="hm",
            cameras=truth.cameras[:3],
            uncalibrated=(UncalibratedCamera("cam3", "too few people"),),
        )

    play(partly)
    assert section().notes[0] == "seed 0: DEGENERATE: hm, cam3: too few people"


def test_an_error_beyond_the_bounds_is_named(play):
    def late(truth):
        cameras = [
            replace(c, time_offset_s=c.time_offset_s + 0.1 * k) for k, c in enumerate(truth.cameras)
        ]
        return replace(truth, cameras=tuple(cameras))

    play(late)
    assert section().notes[0] == "seed 0: E_delta 6"


@pytest.mark.parametrize(("scenes", "needed"), [(30, 29), (15, 15), (60, 58), (3, 3)])
def test_the_share_of_solved_scenes_is_rounded_up(scenes, needed):
    run = measure.Run("default", 0, 1.0, None, "no")
    row = level.summary(SCENARIOS[0], [run] * scenes).rows[0]
    assert row.target == f">= {needed}"


def test_command(play, capsys):
    play(lambda truth: truth)
    assert level.main(["--only", "one", "--scenes", "1"]) == 0
    assert "solved" in capsys.readouterr().out
    assert level.main(["--only", "one", "--scenes", "1", "--json"]) == 0
    (only,) = json.loads(capsys.readouterr().out)
    assert only["name"] == "one"
    assert only["runs"][0]["evaluation"]["E_R"] == 0


def test_what_is_given_out_as_good_and_is_not_is_counted(play):
    def late(truth):
        cameras = [
            replace(c, time_offset_s=c.time_offset_s + 0.1 * k) for k, c in enumerate(truth.cameras)
        ]
        return replace(truth, cameras=tuple(cameras))

    play(late)
    assert verdicts(section().rows)["wrong, but OK"] is False
    play(lambda truth: replace(late(truth), status=Status.DEGENERATE))
    assert verdicts(section().rows)["wrong, but OK"] is True


def test_to_refuse_is_right_where_it_may_be(play):
    def refuse(_):
        raise CalibrationError("nobody moves")

    play(refuse)
    hard = replace(SCENARIO, may_refuse=True)
    rows = level.summary(hard, [measure.run_scene(hard, 0)]).rows
    assert verdicts(rows)["solved"] is True


@pytest.mark.parametrize("how", ["ignored", "given", "estimated"])
def test_line_times_are_given_or_asked_for(monkeypatch, how):
    asked = []

    def take(recording, options):
        asked.append(([c.line_time_s for c in recording.cameras], options.estimate_line_time))
        raise CalibrationError("enough")

    monkeypatch.setattr(measure, "calibrate", take)
    options = SceneOptions(n_cameras=2, n_frames=10, line_time_s=(1e-5, 2e-5))
    measure.run_scene(replace(SCENARIO, options=options, line_times=how), 0)
    assert asked == [([1e-5, 2e-5] if how == "given" else [0.0, 0.0], how == "estimated")]
