"""The benchmark's own arithmetic, with a calibration that is played."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from benchmarks.accuracy import cramer_rao
from benchmarks.accuracy.scenarios import Scenario
from stcalib_ros.core.errors import CalibrationError
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.mocap import shipped_clips

OPTIONS = SceneOptions(n_frames=40, n_cameras=3, n_people=1, seed=5)
CASE = Scenario(
    "short",
    "a short scene",
    OPTIONS,
    2,
    Fraction(1),
    {"E_R": 1.5, "E_t": 1.5, "E_delta": 1.5},
)


def turned_by(factor):
    """Every camera but the first turned by a factor of the mean rotation at its scene's bound."""
    scenes = [simulate(CASE.scene_options(k), clips=shipped_clips()) for k in range(2)]
    angles = [cramer_rao.bounds(scene)[0].E_R for scene in scenes]

    def answer(truth):
        R = exp_so3(np.array([0.0, factor * angles.pop(0), 0.0]))
        first, *others = truth.cameras
        return replace(
            truth,
            cameras=(first, *(replace(c, R_ref_cam=R @ c.R_ref_cam) for c in others)),
        )

    return answer


@pytest.mark.parametrize(("factor", "met"), [(1.4, True), (1.6, False)])
def test_errors_are_judged_in_units_of_the_bound(play, factor, met):
    play(turned_by(factor))
    rows = cramer_rao.summary(CASE, [cramer_rao.compare(CASE, k) for k in range(2)])
    at = [row.figure for row in rows].index("E_R")
    assert f"free points {factor:.2f}x" in rows[at + 1].value
    assert f"on average {factor:.2f}x" in rows[at + 1].value
    assert rows[at + 1].met is met
    assert [row.met for row in rows if row.figure in ("solved", "wrong, but OK")] == [True, True]


def test_scenes_that_are_not_solved_count_as_infinite(play):
    def refuse(_):
        raise CalibrationError("nobody moves")

    play(refuse)
    rows = cramer_rao.summary(CASE, [cramer_rao.compare(CASE, 0)])
    assert rows[0].met is False
    assert "infx" in rows[3].value
    assert rows[3].met is False


def test_command(play, capsys, monkeypatch):
    monkeypatch.setattr(cramer_rao, "CASES", (CASE,))
    play(lambda truth: truth)
    assert cramer_rao.main(["--only", "short", "--scenes", "1"]) == 0
    assert "short: a short scene" in capsys.readouterr().out
    play(turned_by(3.0))
    assert cramer_rao.main(["--scenes", "1"]) == 1
