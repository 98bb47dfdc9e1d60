"""The replay of limits, on solutions made by hand and on two small scenes."""

from __future__ import annotations

from dataclasses import fields, replace
from fractions import Fraction

import pytest
from core_helpers import SOUND

from benchmarks.accuracy import evidence, limits
from benchmarks.accuracy.evidence import Row, Table, read_table, write_table
from benchmarks.accuracy.limits import Count, count, replay, without_bones
from benchmarks.accuracy.scenarios import Scenario
from stcalib_ros.core.synthetic import SceneOptions
from stcalib_ros.core.validation.thresholds import DEFAULT, CheckThresholds

RIGHT = {"E_R": 0.001, "E_t": 0.001, "E_delta": 0.01}
WRONG = {"E_R": 0.5, "E_t": 0.001, "E_delta": 0.01}


def solution(errors, *, otherwise=False, real=False, **changes):
    """A solution of two cameras, one of which is not sound."""
    return Row("made", 0, real, errors, otherwise, (SOUND, replace(SOUND, **changes)))


ROWS = (
    solution(RIGHT),
    solution(WRONG),
    solution(RIGHT, otherwise=True),
    solution(RIGHT, inliers=350),
    solution(WRONG, inliers=350),
    solution(WRONG, inliers=410),
    solution(WRONG, inliers=350, bone_rotation=1.0),
    solution(WRONG, otherwise=True, bone_rotation=0.32),
    solution(RIGHT, depth_ratio=1.5),
    solution(RIGHT, depth_ratio=1 / 1.7),
)


def test_decisions_are_counted():
    assert count(ROWS) == Count(good_refused=3, wrong_refused=3, wrong_published=2)
    assert count(ROWS, replace(DEFAULT, max_depth_ratio=1.3)) == Count(4, 3, 2)


@pytest.mark.parametrize(
    ("limit", "smaller", "larger", "without", "alone"),
    [
        ("min_inliers", Count(2, 2, 3), Count(3, 4, 1), Count(2, 2, 3), Count(1, 2, 3)),
        ("max_depth_ratio", Count(4, 3, 2), Count(2, 3, 2), Count(2, 3, 2), Count(1, 0, 5)),
        ("max_bone_rotation", Count(3, 3, 2), Count(3, 3, 2), Count(3, 3, 2), Count(0, 2, 3)),
        ("certain_bone_rotation", Count(3, 3, 2), Count(3, 3, 2), None, None),
    ],
)
def test_every_limit_is_moved_left_out_and_tried_alone(limit, smaller, larger, without, alone):
    (found,) = (one for one in replay(ROWS) if one.limit == limit)
    assert found.value == getattr(DEFAULT, limit)
    assert (found.smaller, found.larger, found.without, found.alone) == (
        smaller,
        larger,
        without,
        alone,
    )


def test_what_bones_alone_refuse_is_published_without_them():
    rows = (*ROWS, solution(WRONG, bone_rotation=1.0), solution(WRONG, limb_variation=0.3))
    assert count(rows) == Count(3, 5, 2)
    assert count(without_bones(rows)) == Count(3, 4, 3)


def test_what_is_refused_without_any_limit_is_not_counted_alone():
    rows = (solution(WRONG, has_lookalikes=True), solution(WRONG, rotation_stddev=float("inf")))
    assert {one.alone for one in replay(rows) if one.alone is not None} == {Count(0, 0, 0)}


@pytest.mark.parametrize("limit", ["min_shared_s", "min_explained_fraction_if_short"])
def test_limits_of_one_rule_are_tried_together(limit):
    rows = (solution(WRONG, shared_s=1.0, explained_fraction=0.6), solution(RIGHT, inliers=10))
    (found,) = (one for one in replay(rows) if one.limit == limit)
    assert found.alone == Count(0, 1, 0)


def test_no_limit_is_forgotten():
    replayed = [one.limit for one in replay(ROWS)]
    assert sorted([*replayed, *limits.EARLIER]) == sorted(f.name for f in fields(CheckThresholds))


def test_real_recordings_have_bounds_of_their_own():
    errors = {"E_R": 0.05, "E_t": 0.3, "E_delta": 2.0}
    assert solution(errors, real=True).good
    assert not solution(errors).good
    assert not solution(errors | {"E_delta": float("nan")}, real=True).good


def test_the_table_is_read_as_it_was_written(tmp_path):
    odd = solution(
        WRONG, has_lookalikes=True, bone_rotation=float("nan"), offset_peak_ratio=float("inf")
    )
    path = tmp_path / "limits.json"
    write_table(path, Table((*ROWS, odd), 3, ("a.npz",)))
    found = read_table(path)
    assert (found.unsolved, found.absent) == (3, ("a.npz",))
    assert [one.good for one in found.rows] == [one.good for one in (*ROWS, odd)]
    assert replay(found.rows[:-1]) == replay(ROWS)
    assert repr(found.rows[-1].checks) == repr(odd.checks)


def test_the_kept_evidence_counts_real_recordings_apart(capsys):
    assert limits.main([]) == 0
    simulated, real = capsys.readouterr().out.split("real recordings")
    kept = read_table(limits.TABLE)
    n = sum(one.real for one in kept.rows)
    assert f"{len(kept.rows) - n} solutions" in simulated
    assert f"{n} solutions" in real
    assert kept.absent == ()


def test_evidence_is_gathered_anew(monkeypatch, tmp_path, capsys):
    """From two small scenes, without recordings."""
    small = Scenario(
        "small",
        "two small scenes",
        SceneOptions(n_cameras=3, n_people=2, n_frames=80),
        2,
        Fraction(1),
    )
    monkeypatch.setattr(limits, "TABLE", tmp_path / "limits.json")
    monkeypatch.setattr(limits, "SCENARIOS", (small,))
    monkeypatch.setattr(limits, "HARD", ())
    monkeypatch.setattr(evidence, "real_cases", tuple)
    monkeypatch.setattr(evidence, "BALANCE", tmp_path / "absent.npz")
    assert limits.main(["--again", "--scenes", "2"]) == 0
    found = read_table(limits.TABLE)
    assert [one.seed for one in found.rows] == [0, 1]
    assert all(one.good and len(one.checks) == 3 for one in found.rows)
    assert found.absent == ("absent.npz",)
    out = capsys.readouterr().out
    assert "simulated scenes: 2 solutions, 2 good, 0 wrong" in out
    assert "recordings that were absent: 1 (absent.npz)" in out
