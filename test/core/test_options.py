"""Options from a mapping, and what is wrong with one."""

from __future__ import annotations

from dataclasses import fields

import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.options import BundleOptions, Options, option_ranges, options_from_mapping


def test_nothing_given_is_the_default():
    assert options_from_mapping({}) == Options()


def test_values_are_taken_over_at_every_level():
    options = options_from_mapping(
        {"reference": "cam2", "offset_range_s": 1, "bundle": {"rounds": 3}, "seed": 7}
    )
    assert options.reference == "cam2"
    assert options.offset_range_s == 1.0
    assert isinstance(options.offset_range_s, float)
    assert options.bundle.rounds == 3
    assert options.bundle.outlier_factor == Options().bundle.outlier_factor
    assert options.seed == 7


def test_a_reference_may_be_left_to_the_first_camera():
    assert options_from_mapping({"reference": None}).reference is None


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"ofset_range_s": 1.0}, "unknown option ofset_range_s: did you mean offset_range_s?"),
        ({"bundle": {"round": 1}}, "unknown option bundle.round: did you mean rounds?"),
        ({"bundle": 3}, "option bundle holds further options, got 3"),
        ({"offset_range_s": "wide"}, "option offset_range_s: expected float, got 'wide'"),
        ({"seed": 1.5}, "option seed: expected int, got 1.5"),
        ({"seed": True}, "option seed: expected int, got True"),
        ({"min_score": True}, "option min_score: expected float, got True"),
        ({"reference": 3}, "option reference: expected text, got 3"),
        ({"offset_range_s": -1}, "option offset_range_s must be 0 to 3600, got -1.0"),
        ({"offset_range_s": float("nan")}, "option offset_range_s must be 0 to 3600, got nan"),
        ({"offset_range_s": float("inf")}, "option offset_range_s must be 0 to 3600, got inf"),
        ({"min_score": 1.5}, "option min_score must be 0 to 1, got 1.5"),
        ({"min_common_frames": 0}, "option min_common_frames must be 2 to 10000, got 0"),
        ({"seed": -1}, "option seed must be 0 to 2147483648, got -1"),
        ({"world_frame": 3}, "option world_frame: expected text, got 3"),
        ({"estimate_line_time": 1}, "option estimate_line_time: expected bool, got 1"),
        ({"registration": {"min_overlap": 0}}, "registration.min_overlap must be 2 to 10000, got"),
        ({"registration": {"n_candidates": 0}}, "registration.n_candidates must be 1 to 100000"),
        ({"registration": {"n_refined": 2.5}}, "registration.n_refined: expected int, got 2.5"),
        ({"integration": {"n_trees": 0}}, "option integration.n_trees must be 1 to 100000, got 0"),
        ({"bundle": {"rounds": 0}}, "option bundle.rounds must be 1 to 100, got 0"),
        ({"bundle": {"max_iterations": 0}}, "option bundle.max_iterations must be 1 to 1000"),
        ({"bundle": {"outlier_factor": 0.5}}, "option bundle.outlier_factor must be 1 to 100"),
        ({"scale": {"poses_sigma": 0.0}}, "option scale.poses_sigma must be 0.0001 to 1, got 0"),
        ({"scale": {"body_height_m": -1.0}}, "option scale.body_height_m must be 0 to 3, got -1"),
        (
            {"registration": {"method": "icp"}},
            "registration.method must be one of correlation, vmf, got 'icp'",
        ),
        ({"vmf": {"initial": "zero"}}, "vmf.initial must be one of random, candidates, got 'ze"),
        ({"vmf": {"window": 1}}, "vmf.window must be 2 to 10000, got 1"),
        ({"vmf": {"no_match_rad": 0.0}}, "vmf.no_match_rad must be 0.01 to 3.2, got 0.0"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(given, says):
    with pytest.raises(InputError, match=says) as caught:
        options_from_mapping(given)
    assert "\n" not in str(caught.value)


def test_records_made_in_python_are_checked_as_well():
    with pytest.raises(InputError, match=r"option bundle\.rounds must be 1 to 100, got 0"):
        BundleOptions(rounds=0)
    with pytest.raises(InputError, match=r"option seed: expected int, got 1\.5"):
        Options(seed=1.5)


def test_every_number_among_the_options_has_a_range_that_holds_its_default():
    ranges = option_ranges()
    records = {"": Options()} | {
        f"{name}.": getattr(Options(), name)
        for name in ("registration", "vmf", "integration", "bundle", "scale", "lens")
    }
    numbers = {
        f"{prefix}{one.name}": getattr(record, one.name)
        for prefix, record in records.items()
        for one in fields(record)
        if one.type in ("int", "float")
    }
    assert ranges.keys() == numbers.keys()
    assert all(ranges[key].low <= value <= ranges[key].high for key, value in numbers.items())
