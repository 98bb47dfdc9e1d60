"""The benchmark's own arithmetic, with a calibration that is played."""

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from exclusion_helpers import left_out

from benchmarks.accuracy import level, measure
from benchmarks.accuracy.real import DEMO, Converted, RealCase
from benchmarks.accuracy.scenarios import SCENARIOS, KeypointTargets, Scenario
from benchmarks.accuracy.summary import summary, summary_2d, unobservable_frames
from stcalib_ros.core.errors import CalibrationError
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.synthetic import SceneOptions

SCENARIO = Scenario(
    "short", "a short scene", SceneOptions(n_frames=20), 3, Fraction(2, 3), {"E_R": 0.001}
)


def section(n_scenes=3):
    return summary(SCENARIO, [measure.run_scene(SCENARIO, k) for k in range(n_scenes)])


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
    note = "seed 0: DEGENERATE: hm, cam3: too few people [UNSPECIFIED]"
    assert section().notes[0] == note


def test_an_error_beyond_the_bounds_is_named(play):
    play(late)
    assert section().notes[0] == "seed 0: E_delta 6"


@pytest.mark.parametrize(("scenes", "needed"), [(30, 29), (15, 15), (60, 58), (3, 3)])
def test_the_share_of_solved_scenes_is_rounded_up(scenes, needed):
    run = measure.Run("default", 0, 1.0, None, "no")
    row = summary(SCENARIOS[0], [run] * scenes).rows[0]
    assert row.target == f">= {needed}"


def test_command(play, capsys):
    play(lambda truth: truth)
    assert level.main(["--only", "one", "--scenes", "1"]) == 0
    out = capsys.readouterr().out
    assert "with 3D poses" in out
    assert "2D only" in out
    assert level.main(["--only", "one", "--scenes", "1", "--json"]) == 0
    with_3d, without = json.loads(capsys.readouterr().out)
    assert with_3d["name"] == without["name"] == "one"
    assert (with_3d["poses"], without["poses"]) == ("3d", "2d")
    assert without["runs"][0]["evaluation"]["E_R"] == 0
    assert level.main(["--only", "one", "--scenes", "1", "--poses", "2d"]) == 0
    assert "with 3D poses" not in capsys.readouterr().out


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
    rows = summary(hard, [measure.run_scene(hard, 0)]).rows
    assert verdicts(rows)["solved"] is True


def test_harder_scenes_stand_beside_the_same_without_that(play):
    def runs(frames):
        play(lambda truth: late(truth, frames))
        return [measure.run_scene(SCENARIO, k) for k in range(2)]

    harder, clean = replace(SCENARIO, beside="clean"), runs(0.01)
    for frames, met in ((0.014, True), (0.016, False)):
        rows = summary(harder, runs(frames), [*clean, *runs(0.1)]).rows
        (row,) = (row for row in rows if row.figure == "E_delta / clean")
        assert float(row.value) == pytest.approx(100 * frames, rel=0.01)
        assert (row.target, row.met) == ("<= 1.5", met)


def test_the_worst_tenth_has_a_limit_of_its_own(play):
    play(lambda truth: late(truth, 0.01))
    asked = {"medians": {"E_delta": 1.0}, "p90": {"E_delta": 0.001}}
    runs = [measure.run_scene(SCENARIO, k) for k in range(2)]
    (row,) = (
        row for row in summary(replace(SCENARIO, **asked), runs).rows if row.figure == "E_delta"
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


def runs_late(play, frames, n_scenes=2):
    play(lambda truth: late(truth, frames))
    return [measure.run_scene(SCENARIO, k) for k in range(n_scenes)]


@pytest.mark.parametrize(("frames", "met"), [(0.0119, True), (0.0121, False)])
def test_without_3d_poses_medians_are_compared_with_those_with_them(play, frames, met):
    with_3d, without = runs_late(play, 0.01), runs_late(play, frames)
    rows = summary_2d(SCENARIO, without, (), with_3d).rows
    assert verdicts(rows)["E_delta"] is met
    assert "CPU / with 3D" in verdicts(rows)
    alone = verdicts(summary_2d(SCENARIO, without).rows)
    assert (alone["solved"], alone["E_delta"]) == (None, None)


@pytest.mark.parametrize(("failed", "met"), [(1, True), (2, False)])
def test_without_3d_poses_one_scene_less_may_be_solved(play, failed, met):
    with_3d = runs_late(play, 0.0, 3)
    without = [replace(run, failure="no") for run in with_3d[:failed]] + with_3d[failed:]
    assert verdicts(summary_2d(SCENARIO, without, (), with_3d).rows)["solved"] is met


def test_a_scenario_can_have_targets_of_its_own_without_3d_poses(play):
    runs = runs_late(play, 0.01)
    asked = replace(SCENARIO, keypoints_only=KeypointTargets(Fraction(1), {"E_delta": 0.001}))
    rows = summary_2d(asked, runs, (), runs_late(play, 0.1)).rows
    assert (verdicts(rows)["solved"], verdicts(rows)["E_delta"]) == (True, False)
    assert verdicts(summary_2d(asked, [replace(runs[0], failure="no")]).rows)["solved"] is False


def test_cost_is_compared_with_that_of_the_easier_scenario(play):
    clean = [replace(run, cpu_s=1.0) for run in runs_late(play, 0.01)]
    for cpu_s, met in ((1.9, True), (2.1, False)):
        runs = [replace(run, cpu_s=cpu_s) for run in clean]
        found = summary(replace(SCENARIO, beside="easy", cpu_ratio=2.0), runs, clean).rows
        assert verdicts(found)["CPU / easy"] is met
        assert "E_delta / easy" not in verdicts(found)


def test_the_scenario_says_how_far_offsets_are_searched_and_what_is_altered(monkeypatch):
    asked = []

    def take(recording, options):
        asked.append((len(recording.cameras[0].tracks), options.offset_range_s))
        raise CalibrationError("enough")

    def emptied(scene):
        cameras = tuple(replace(c, tracks=()) for c in scene.recording.cameras)
        return replace(scene, recording=replace(scene.recording, cameras=cameras))

    monkeypatch.setattr(measure, "calibrate", take)
    measure.run_scene(replace(SCENARIO, offset_range_s=60.0, alter=emptied), 0)
    assert asked == [(0, 60.0)]


@pytest.fixture
def tiny_case(play):
    """A recording that calls itself real, whose calibration is its truth, late."""

    def read() -> Converted:
        scene = measure.simulate(SceneOptions(n_frames=20, n_people=2))
        return Converted(scene.recording, scene.truth)

    limits = {"E_R": 0.01, "offset frames": 1.0}
    case = RealCase("tiny", "", read, 30.0, limits)

    def made(frames, **changes):
        play(lambda truth: replace(late(truth, frames), **changes))
        return case

    return made


def test_a_real_recording_has_limits(tiny_case):
    assert verdicts(level.real(tiny_case(0.1), "2d").rows)["offset frames"] is True
    found = verdicts(level.real(tiny_case(1.0), "2d").rows)
    assert (found["offset frames"], found["wrong, but OK"]) == (False, True)
    found = verdicts(level.real(tiny_case(1.5), "2d").rows)
    assert found["wrong, but OK"] is False


def test_a_real_recording_may_be_refused_but_not_wrong(tiny_case):
    case = replace(tiny_case(1.0, status=Status.DEGENERATE), may_refuse=True)
    assert False not in verdicts(level.real(case, "2d").rows).values()
    assert verdicts(level.real(replace(case, may_refuse=False), "2d").rows)["solved"] is False
    case = replace(tiny_case(1.5), may_refuse=True)
    assert verdicts(level.real(case, "2d").rows)["wrong, but OK"] is False


def test_the_demo_has_a_column_with_its_3d_poses(monkeypatch, tiny_case, capsys):
    case = replace(tiny_case(0.0), name=DEMO.name)
    monkeypatch.setattr(level, "_REAL", {"3d": (case,), "2d": (case,)})
    assert level.main(["--only", "demo"]) == 0
    assert "with 3D poses" in capsys.readouterr().out


def test_the_mean_of_timestamp_jitter_is_not_asked_for():
    rng = np.random.default_rng(1)
    options = SceneOptions(n_cameras=3, n_frames=200, stamp_jitter_s=0.005, fps=30.0)
    means = rng.normal(0.0, 0.005, (1_000, 3, 200)).mean(2)
    error = np.abs(means[:, 1:] - means[:, :1]).mean() * 30.0
    assert unobservable_frames(options) == pytest.approx(error, rel=0.05)
    assert unobservable_frames(SceneOptions()) == 0.0
