"""The experiments as commands: scenes, resumption, tables, and the gate."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.paper import __main__ as command
from benchmarks.paper import gate, pairwise
from benchmarks.paper.baselines import BASELINES
from benchmarks.paper.experiments import EXPERIMENTS, Experiment
from benchmarks.paper.multiview import rig_errors
from benchmarks.paper.pairwise import N_FRAMES, T, inside_windows, noise_rows
from benchmarks.paper.report import read_notes, write_report
from benchmarks.paper.run import Row, Task, row, run_tasks, stored
from benchmarks.paper.scenes import SCENES, SEARCH_FRAMES, late, seen_by, window_starts
from benchmarks.paper.tables import PRINTED, tables
from stcalib_ros.core.evaluation.metrics import evaluate
from stcalib_ros.core.synthetic import SceneOptions, simulate

calls: list[int] = []


def numbered(k: int) -> list[Row]:
    calls.append(k)
    if k == 3:
        raise RuntimeError("stopped")
    return [row("scene", "default", "IBA", k, None, E_R=float(k), E_t=float("nan"))]


def tasks(n: int) -> list[Task]:
    return [Task(f"task {k}", numbered, (k,)) for k in range(n)]


def test_an_interrupted_experiment_goes_on(tmp_path: Path) -> None:
    store = tmp_path / "out" / "x.jsonl"
    calls.clear()
    with pytest.raises(RuntimeError):
        run_tasks(tasks(5), store, jobs=1, name="x")
    with store.open("a") as file:
        file.write('{"key": "task 2", "ro')
    calls.clear()
    rows = run_tasks([t for t in tasks(5) if t.key != "task 3"], store, jobs=1, name="x")
    assert calls == [4]
    assert [r["E_R"] for r in rows] == [0.0, 1.0, 2.0, 4.0]
    assert {key for key, _ in stored(store)} == {f"task {k}" for k in (0, 1, 2, 4)}


def test_what_is_not_finite_is_null_in_the_store(tmp_path: Path) -> None:
    store = tmp_path / "x.jsonl"
    run_tasks(tasks(1), store, jobs=1, name="x")
    ((_, rows),) = stored(store)
    assert rows[0]["E_t"] is None


def test_scenes_have_the_people_of_table_ii() -> None:
    assert [s.n_people for s in SCENES] == [6, 3, 3, 6, 2, 2, 6, 7, 7]
    assert all(5 <= s.T <= 15 for s in SCENES)
    assert [s.name for s in SCENES] == list(PRINTED["table2"])[1:]


def test_windows_are_uniform_and_inside() -> None:
    starts = window_starts(300, 5, 20)
    assert starts[0] == 0
    assert starts[-1] == 295
    assert set(np.diff(starts)) <= {15, 16}


def test_windows_have_a_counterpart_at_every_offset() -> None:
    starts = inside_windows(20)
    assert min(starts) == SEARCH_FRAMES
    assert max(starts) + T + SEARCH_FRAMES == N_FRAMES


def test_without_3d_poses_only_the_default_is_run() -> None:
    recording = simulate(SceneOptions(n_frames=10, n_people=1)).recording
    for method, known in (("2D only", False), ("default", True), ("paper", True)):
        (track,) = seen_by(method, recording).cameras[0].tracks
        assert bool(np.isfinite(track.joints).any()) is known
        np.testing.assert_array_equal(track.keypoints, recording.cameras[0].tracks[0].keypoints)


def test_late_clocks_are_in_the_truth() -> None:
    scene = simulate(SceneOptions(n_frames=20, n_people=1, max_offset_frames=0.0))
    recording, truth = late(scene.recording, scene.truth, 5)
    found = evaluate(scene.truth, truth, fps=30.0)
    assert found.E_delta == pytest.approx(5.0)
    shift = scene.recording.cameras[1].stamps - recording.cameras[1].stamps
    np.testing.assert_allclose(shift, [c.time_offset_s for c in truth.cameras][1])
    zero = np.zeros(4)
    R, t = (np.stack([getattr(c, n) for c in truth.cameras]) for n in ("R_ref_cam", "t_ref_cam"))
    errors = rig_errors(R, 2.5 * t, zero, truth)
    assert errors["E_R"] < 1e-7
    assert errors["E_t"] < 1e-12
    assert errors["E_delta"] == pytest.approx(5.0)


def test_one_noisy_observation_by_every_method(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pairwise, "N_WINDOWS", 8)
    rows = noise_rows("three people, ring", 1.0, 0, 1)
    methods = {"default", "2D only", "paper", "paper, 10 starts", *BASELINES}
    assert {r["method"] for r in rows} == methods
    for method in methods - {"paper"}:
        mine = [r for r in rows if r["method"] == method and r["stage"] == "windows"]
        assert len(mine) == 6
    starts = [r for r in rows if r["method"] == "paper"]
    assert len(starts) == 12
    assert all(r["E_R"] is not None for r in starts), "a start that failed is left out of the mean"
    for method in ("default", "2D only", "paper, 10 starts"):
        mine = [r for r in rows if r["method"] == method and r["stage"] == "windows"]
        assert max(r["E_R"] for r in mine) < 0.01
        assert all(r["precision"] == 1.0 for r in mine)


def figure_rows(scene: str, method: str, stage: str, **figures: float) -> list[Row]:
    return [row(scene, method, stage, k, None, missing=0, **figures) for k in range(2)]


def varied_rows(k: int) -> list[Row]:
    return [row("s", "default", "IBA", k, None, missing=0, E_R=float(k))]


def test_tables_show_measured_and_printed() -> None:
    rows = figure_rows("soccer1_6", "paper", "IBA", E_R=0.0123, E_t=0.5, E_2D=4.0)
    text = tables("table1", rows)
    assert "0.012 [0.006]" in text
    assert "2 of 2" in text
    rows = figure_rows("170915_toddler5", "paper w/o RANSAC", "windows", E_R=0.3, E_t=0.1)
    assert "0.300 [0.005]" in tables("table3", rows)
    failed = [row("ballet", "Vo et al.", "STBA", 0, None, failure="no initial image pair")]
    assert "| Vo et al. | STBA | - |" in tables("table2", failed)


def test_gate_tells_worse_from_noise() -> None:
    trials = [
        gate.averages("t", figure_rows("s", "default", "IBA", E_R=value, precision=1.0))
        for value in (0.010, 0.012, 0.008)
    ]
    baseline = gate.make_baseline(trials)
    assert gate.regressions(trials[0], baseline) == []
    near = gate.averages("t", figure_rows("s", "default", "IBA", E_R=0.0125, precision=1.0))
    assert gate.regressions(near, baseline) == []
    worse = gate.averages("t", figure_rows("s", "default", "IBA", E_R=0.02, precision=0.9))
    lines = gate.regressions(worse, baseline)
    assert len(lines) == 2
    assert "E_R 0.02, was 0.01" in lines[0]
    failed = gate.averages("t", [row("s", "default", "IBA", 0, None, failure="none")])
    assert any("no E_R any more" in line for line in gate.regressions(failed, baseline))
    assert gate.regressions({}, baseline) == ["t; s; default; IBA: no such row any more"]


def test_gate_leaves_the_baselines_alone() -> None:
    assert gate.averages("t", figure_rows("s", "ARCS", "PR", E_R=1.0)) == {}


def test_command_fails_when_accuracy_gets_worse(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def reduced(k: int) -> list[Task]:
        return [Task(f"trial {k}", figure_rows, ("s", "default", "IBA"))] if k == 0 else []

    experiment = Experiment("Title", list, reduced)
    monkeypatch.setattr(command, "EXPERIMENTS", {"table1": experiment})
    for value, status in ((9.0, 0), (0.0, 1)):
        rows = {"table1; s; default; IBA": {"missing": {"value": value - 1.0, "stddev": 0.0}}}
        monkeypatch.setattr(gate, "read_baseline", lambda rows=rows: rows)
        assert command.main(["table1", "--reduced", "--jobs", "1"]) == status
    assert "worse than the baseline" in capsys.readouterr().out


def test_the_baseline_of_one_experiment_leaves_the_others(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def reduced(k: int) -> list[Task]:
        return [Task(f"trial {k}", varied_rows, (k,))]

    monkeypatch.setattr(command, "EXPERIMENTS", {"table1": Experiment("Title", list, reduced)})
    monkeypatch.setattr(gate, "BASELINE", tmp_path / "baseline.json")
    other = {"table3; s; default; windows": {"E_R": {"value": 1.0, "stddev": 0.0}}}
    gate.BASELINE.write_text(json.dumps(other | {"table1; gone; default; IBA": {}}))
    assert command.main(["table1", "--update-baseline", "--jobs", "1"]) == 0
    found = gate.read_baseline()
    assert found.keys() == {*other, "table1; s; default; IBA"}
    expected = {"value": 0.0, "stddev": pytest.approx(np.std(range(5)))}
    assert found["table1; s; default; IBA"]["E_R"] == expected


def test_committed_baseline_is_of_the_reduced_set() -> None:
    names = {name for name, e in EXPERIMENTS.items() if e.reduced(0)} - {"table4"}
    assert {key.split("; ")[0] for key in gate.read_baseline()} == names
    assert all(len({t.key for t in e.tasks()}) == len(e.tasks()) for e in EXPERIMENTS.values())


def test_report_says_what_was_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert set(read_notes()) == {"introduction", "peers", *EXPERIMENTS}
    monkeypatch.setattr("benchmarks.paper.report.PAGE", tmp_path / "results.md")
    monkeypatch.setattr("benchmarks.paper.report.FIGURE", tmp_path / "noise.png")
    rows = [
        row("s", "default", s, 0, None, E_R=0.01, sigma_px=1.0) for s in ("windows", "one window")
    ]
    run_tasks([Task("one", lambda: rows, ())], tmp_path / "noise.jsonl", jobs=1, name="noise")
    write_report(tmp_path)
    text = (tmp_path / "results.md").read_text()
    assert "Incomplete: 1 of 50 tasks." in text
    assert "Not run yet." in text
    assert (tmp_path / "noise.png").stat().st_size > 5000
