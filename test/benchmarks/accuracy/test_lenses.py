"""Scenes whose lenses are to be found, with a calibration that is played."""

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from benchmarks.accuracy import level, measure
from benchmarks.accuracy.lens_summary import lens_section
from benchmarks.accuracy.lenses import (
    ASSUMED_FOCAL_PX,
    FOCAL_SPREAD,
    LENS_SCENARIOS,
    LensRange,
    LensScenario,
    run_lens_scene,
    with_poorer_lenses,
)
from benchmarks.accuracy.real import DEMO
from benchmarks.accuracy.scenarios import Scenario
from stcalib_ros.core.errors import CalibrationError
from stcalib_ros.core.lifting.assumed_lenses import assumed_lens
from stcalib_ros.core.model.lens_knowledge import LensKnowledge, LensStddev
from stcalib_ros.core.model.recording import LensModel, unknown_intrinsics
from stcalib_ros.core.options import LensOptions
from stcalib_ros.core.synthetic import SceneOptions, simulate

UNKNOWN, REFINE = LensKnowledge.UNKNOWN, LensKnowledge.REFINE
OPTIONS = SceneOptions(n_frames=20, n_people=2)
KIND = LensScenario(
    Scenario("short", "a short scene", OPTIONS, 2, Fraction(1), {"E_f": 0.01, "E_k1": 0.02})
)


def estimated(truth, *, focal=1.0, k1=0.0, stddev_px=10.0):
    """The truth, with lenses that were estimated with these errors."""
    cameras = [
        replace(
            camera,
            intrinsics=replace(
                camera.intrinsics,
                K=camera.intrinsics.K * np.array([[focal], [focal], [1.0]]) ** np.eye(3),
                D=camera.intrinsics.D + np.eye(5)[0] * k1,
            ),
            lens_knowledge=UNKNOWN,
            lens_stddev=LensStddev(stddev_px, 0.0, 0.0, (0.01,)),
            covariance=np.eye(6),
            time_offset_stddev_s=1.0,
        )
        for camera in truth.cameras
    ]
    return replace(truth, cameras=tuple(cameras))


def section(n_scenes=2, kind=KIND, poses="3d"):
    return lens_section(
        kind, [run_lens_scene(kind, UNKNOWN, poses, k) for k in range(n_scenes)], poses
    )


def row(found, figure):
    return next(one for one in found.rows if one.figure == figure)


def test_the_assumed_focal_length_is_that_of_the_calibration():
    assert assumed_lens(unknown_intrinsics(1920, 1080)).K[0, 0] == ASSUMED_FOCAL_PX


def test_lenses_are_drawn_by_the_seed_one_for_each_camera():
    lenses = LensRange((900.0, 1100.0), ((-0.1, -0.05),), LensModel.EQUIDISTANT, 0.01)
    one, same, other = (lenses.drawn(SceneOptions(seed=s)) for s in (1, 1, 2))
    assert one == same
    assert len(set(one.focal_px)) == 4
    assert all(900.0 <= focal <= 1100.0 for focal in (*one.focal_px, *other.focal_px))
    assert other.focal_px != one.focal_px
    assert -0.1 <= one.distortion[0] <= -0.05
    assert one.principal_point_px == 0.01 * 1920
    truth = simulate(replace(one, n_frames=5)).truth
    assert [c.intrinsics.model for c in truth.cameras] == [LensModel.EQUIDISTANT] * 4


@pytest.mark.parametrize("kind", LENS_SCENARIOS, ids=lambda kind: kind.scenario.name)
def test_scenes_are_those_that_they_are_said_to_be(kind):
    options = kind.scene_options(1)
    assert options.seed == kind.scenario.options.seed + 1
    if "wide" not in kind.scenario.name:
        off = np.array(options.focal_px) / ASSUMED_FOCAL_PX - 1.0
        assert np.abs(off).max() <= FOCAL_SPREAD
        return
    lens = simulate(replace(options, n_frames=5)).truth.cameras[0].intrinsics
    if lens.model is LensModel.EQUIDISTANT:
        half = 960 / lens.K[0, 0]
    else:
        half = np.arctan(960 / lens.K[0, 0])
    assert 115.0 < 2 * np.degrees(half) < 140.0


def test_nothing_but_the_size_of_the_images_is_left():
    scene = simulate(OPTIONS)
    for camera in with_poorer_lenses(scene.recording, UNKNOWN, LensOptions(), 0).cameras:
        assert not camera.intrinsics.known
        assert (camera.intrinsics.width, camera.intrinsics.height) == (1920, 1080)


def test_data_sheets_are_off_by_as_much_as_the_option_says():
    scene = simulate(replace(OPTIONS, n_frames=5, distortion=(0.1,)))
    ratios = [
        camera.intrinsics.K[0, 0] / 1400.0 - 1.0
        for seed in range(40)
        for camera in with_poorer_lenses(
            scene.recording, REFINE, LensOptions(focal_stddev=0.05), seed
        ).cameras
    ]
    assert np.std(ratios) == pytest.approx(0.05, rel=0.25)
    assert np.abs(ratios).max() == pytest.approx(0.1)
    guessed = with_poorer_lenses(scene.recording, REFINE, LensOptions(), 0).cameras[0].intrinsics
    assert not guessed.D.any()


@pytest.mark.parametrize(("focal", "k1", "met"), [(1.009, 0.019, True), (1.011, 0.021, False)])
def test_errors_of_lenses_have_limits(play, focal, k1, met):
    play(lambda truth: estimated(truth, focal=focal, k1=k1))
    found = section()
    assert row(found, "solved").value == "2 of 2, with given lenses 2"
    assert (row(found, "E_f").met, row(found, "E_k1").met) == (met, met)
    assert row(found, "CPU / given").target == "<= 1.5"


@pytest.mark.parametrize(("deviations", "met"), [(0.5, False), (1.0, True), (2.0, False)])
def test_errors_are_to_be_as_large_as_they_are_said_to_be(play, deviations, met):
    def answer(truth):
        return estimated(
            truth, focal=1.005, stddev_px=0.005 * truth.cameras[0].intrinsics.K[0, 0] / deviations
        )

    kind = replace(KIND, lenses=LensRange((1400.0, 1400.0)))
    play(answer)
    found = section(kind=kind)
    assert row(found, "NEES focal length").met is met
    assert f"mean {deviations**2:.2f}" in row(found, "NEES focal length").value
    assert "NEES principal point" not in [one.figure for one in found.rows]


def test_errors_are_compared_with_those_of_given_lenses(play):
    answers = []

    def late(frames):
        def answer(truth):
            cameras = [
                replace(c, time_offset_s=c.time_offset_s + frames / 30.0 * k)
                for k, c in enumerate(truth.cameras)
            ]
            return replace(truth, cameras=tuple(cameras))

        return answer

    def alternating(truth):
        answers.append(None)
        return late(0.01 if len(answers) % 2 else 0.015)(truth)

    play(alternating)
    found = section()
    assert float(row(found, "E_delta / given").value) == pytest.approx(1.5, rel=1e-3)
    assert row(found, "E_delta / given").met is False


def test_scenes_for_information_miss_nothing(play):
    def refuse(_):
        raise CalibrationError("nobody moves")

    play(refuse)
    kind = replace(KIND, scenario=replace(KIND.scenario, medians={}))
    found = section(kind=kind)
    assert [one.met for one in found.rows if one.met is not None] == [True]
    assert found.notes[0] == "seed 0: nobody moves"
    assert row(section(), "solved").met is False


def test_command(play, capsys):
    play(lambda truth: truth)
    arguments = ["--intrinsics", "unknown", "--only", "two cameras", "--scenes", "1"]
    assert level.main(arguments) == 0
    out = capsys.readouterr().out
    assert "two cameras: two of them" in out
    assert "2D only" in out
    level.main([*arguments, "--json"])
    with_3d, without = json.loads(capsys.readouterr().out)
    assert (with_3d["poses"], without["poses"]) == ("3d", "2d")
    assert len(with_3d["runs"][0]["evaluation"]["lenses"]) == 2


def test_recordings_stand_beside_the_same_with_their_lenses(monkeypatch, capsys):
    asked = []
    _, truth = DEMO.read()

    def take(given, options):
        asked.append(
            (given.cameras[0].intrinsics.known, None if options is None else options.intrinsics)
        )
        return truth

    monkeypatch.setattr(measure, "calibrate", take)
    assert level.main(["--intrinsics", "unknown", "--only", "demo", "--poses", "3d"]) == 0
    assert "CPU / given" in capsys.readouterr().out
    level.main(["--intrinsics", "refine", "--only", "demo", "--poses", "3d"])
    assert asked == [(True, None), (False, "unknown"), (True, None), (True, "refine")]
