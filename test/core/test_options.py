"""Options from a mapping, and what is wrong with one."""

from __future__ import annotations

import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.options import Options, options_from_mapping


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
        ({"ofset_range_s": 1.0}, "unknown option ofset_range_s: there are reference, offset_ran"),
        ({"bundle": {"round": 1}}, "unknown option bundle.round: there are rounds"),
        ({"bundle": 3}, "option bundle holds further options, got 3"),
        ({"offset_range_s": "wide"}, "option offset_range_s: expected float, got 'wide'"),
        ({"seed": 1.5}, "option seed: expected int, got 1.5"),
        ({"seed": True}, "option seed: expected int, got True"),
        ({"min_score": True}, "option min_score: expected float, got True"),
        ({"reference": 3}, "option reference: expected text, got 3"),
        ({"offset_range_s": -1}, "offset_range_s must be at least 0, got -1.0"),
        ({"offset_range_s": float("nan")}, "offset_range_s must be at least 0, got nan"),
        (
            {"registration": {"method": "icp"}},
            "registration.method must be one of correlation, vmf, got 'icp'",
        ),
        ({"vmf": {"initial": "zero"}}, "vmf.initial must be one of random, candidates, got 'ze"),
        ({"vmf": {"window": 1}}, "vmf.window must be at least 2, got 1"),
        ({"vmf": {"no_match_rad": 0.0}}, "vmf.no_match_rad must be above 0, got 0.0"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(given, says):
    with pytest.raises(InputError, match=says) as caught:
        options_from_mapping(given)
    assert "\n" not in str(caught.value)
