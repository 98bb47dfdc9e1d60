"""The benchmark's own arithmetic, with a calibration that is played."""

import json
from dataclasses import replace
from fractions import Fraction

import pytest
from exclusion_helpers import left_out

from benchmarks.accuracy import level, measure
from benchmarks.accuracy.scenarios import SCENARIOS, Scenario
from stcalib_ros.core.errors import CalibrationError
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.synthetic import SceneOptions

SCENARIO = Scenario(
    "short", "a short scene", SceneOptions(n_frames=20), 3, Fraction(2, 3), {"E_R": 0.001}
)


def section(n_scenes=3):
    return level.summary(SCENARIO, [measure.run_scene(SCENARIO, k) for k in range(n_scenes)])


def late(truth, frames=3.0):
    """Every camera's clock by so many frames more than that of the one before it."""
    cameras = [
        replace(c, time_offset_s=c.time_offset_s + frames / 30.0 * k)
        for k, c in enumerate(truth.cameras)
    ]
    return replace(truth, cameras=tuple(cameras))


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
            uncalibrated=(left_out("cam3", "too few people"),),
        )

    play(partly)
    assert section().notes[0] == "seed 0: DEGENERATE: hm, cam3: too few people"


def test_an_error_beyond_the_bounds_is_named(play):
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


def test_harder_scenes_stand_beside_the_same_without_that(play):
    def runs(frames):
        play(lambda truth: late(truth, frames))
        return [measure.run_scene(SCENARIO, k) for k in range(2)]

    harder, clean = replace(SCENARIO, beside="clean"), runs(0.01)
    for frames, met in ((0.014, True), (0.016, False)):
        rows = level.summary(harder, runs(frames), [*clean, *runs(0.1)]).rows
        (row,) = (row for row in rows if row.figure == "E_delta / clean")
        assert float(row.value) == pytest.approx(100 * frames, rel=0.01)
        assert (row.target, row.met) == ("<= 1.5", met)


def test_the_worst_tenth_has_a_limit_of_its_own(play):
    play(lambda truth: late(truth, 0.01))
    asked = {"medians": {"E_delta": 1.0}, "p90": {"E_delta": 0.001}}
    runs = [measure.run_scene(SCENARIO, k) for k in range(2)]
    (row,) = (
        row
        for row in level.summary(replace(SCENARIO, **asked), runs).rows
        if row.figure == "E_delta"
    )
    assert (row.target, row.met) == ("median <= 1, p90 <= 0.001", False)


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
