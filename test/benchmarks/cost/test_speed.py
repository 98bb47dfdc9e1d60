"""The benchmark's own arithmetic, and one tiny case that is really run."""

import json
from dataclasses import replace

import pytest

from benchmarks.cost import speed
from benchmarks.cost.timing import StageClock, Timing, in_own_process
from stcalib_ros.core.options import Options
from stcalib_ros.core.synthetic import SceneOptions

TINY = SceneOptions(n_frames=60, n_cameras=2, n_people=2, id_switches_per_10s=0, seed=3)


def timing(cpu_s=1.0, peak_mb=100.0, solve_mb=10.0, failure=""):
    return Timing(
        {"checking the input": 0.25 * cpu_s, "checking the result": 0.75 * cpu_s},
        peak_mb,
        solve_mb,
        failure,
    )


def verdicts(section):
    return {row.figure: row.met for row in section.rows}


@pytest.fixture
def played(monkeypatch):
    """Calibrations whose cost is a function of their size."""

    def cost(scene, options, *, without_3d):
        size = scene.n_frames * scene.n_cameras**1.5 * scene.n_people
        factor = 2.0 if without_3d else 1.0
        return timing(factor * 1e-5 * size * (1 + 0.01 * options.offset_range_s))

    monkeypatch.setattr(speed, "in_own_process", cost)
    monkeypatch.setattr(speed, "startup_cpu_s", lambda: 0.1)


def test_a_tiny_case_is_measured_in_its_own_process():
    found = in_own_process(TINY, Options(offset_range_s=0.5))
    assert found.failure == ""
    assert list(found.stages)[:2] == ["checking the input", "matching camera pairs"]
    assert list(found.stages)[-1] == "checking the result"
    assert all(cpu_s >= 0 for cpu_s in found.stages.values())
    assert 0 < found.cpu_s < 60
    assert 0 < found.solve_mb < found.peak_mb < 1000


def test_the_clock_charges_time_to_the_stage_that_is_under_way(monkeypatch):
    now = iter([0.0, 1.0, 3.0, 4.0, 9.0])
    monkeypatch.setattr("benchmarks.cost.timing.time.process_time", lambda: next(now))
    clock = StageClock()
    for stage in ("checking the input", "checking the result", "checking the input", ""):
        clock(stage, 0.0)
    assert clock.stages == {"checking the input": 7.0, "checking the result": 1.0}


def test_medians_of_time_and_the_largest_memory_are_judged():
    case = replace(speed.CASES[0], cpu_s=2.0, peak_mb=150.0, solve_mb=5.0)
    found = speed.summary(case, [timing(1.0), timing(1.9, 200.0), timing(9.0)])
    assert verdicts(found) == {"CPU s": True, "peak MB": False, "solve MB": False}
    assert found.rows[0].value == pytest.approx(1.9)
    assert found.rows[1].value == 200.0
    assert found.stages["checking the result"] == pytest.approx(0.75 * 1.9)


def test_a_scene_that_is_not_solved_is_named():
    found = speed.summary(speed.CASES[0], [timing(), timing(failure="E_R 1")])
    assert found.notes == ("seed 1001: E_R 1",)


@pytest.mark.parametrize("power", [0.5, 1.0, 2.5])
def test_the_exponent_of_a_power_law(power):
    growth = speed.Growth("n", {"a": 2, "b": 5, "c": 11}, 2.0)
    cost = {name: 3.0 * n**power for name, n in growth.sizes.items()}
    assert speed.exponent(growth, cost) == pytest.approx(power)


def test_growth_is_left_out_where_cases_were_not_run(played):
    sections = [speed.summary(case, speed.measured(case, 1)) for case in speed.CASES[:3]]
    assert [s.name for s in speed.comparisons({s.name: s for s in sections})] == [
        "growth in frames"
    ]


def test_command(played, capsys):
    assert speed.main(["--only", "base", "--scenes", "1"]) == 0
    assert "CPU s" in capsys.readouterr().out
    assert speed.main(["--scenes", "1", "--json"]) == 0
    sections = {s["name"]: s for s in json.loads(capsys.readouterr().out)}
    assert sections["growth in cameras"]["rows"][0]["value"] == pytest.approx(1.5)
    assert sections["offset range"]["rows"][0]["value"] == pytest.approx(1.1 / 1.0033)


def test_every_case_is_measured_without_3d_poses_too(played):
    given = {case.name: case for case in speed.CASES}
    for name, case in given.items():
        assert case.without_3d == name.endswith("-2d")
        assert name in given if case.without_3d else f"{name}-2d" in given
    base, without = (speed.measured(given[name], 1)[0] for name in ("base", "base-2d"))
    assert without.cpu_s == pytest.approx(2.0 * base.cpu_s)


def test_a_missed_target_is_an_exit_status(played, monkeypatch):
    monkeypatch.setattr(speed, "startup_cpu_s", lambda: 0.6)
    assert speed.main(["--only", "start"]) == 1
    monkeypatch.setattr(speed, "in_own_process", lambda *_, **__: timing(failure="no"))
    assert speed.main(["--only", "narrow", "--scenes", "1"]) == 1
