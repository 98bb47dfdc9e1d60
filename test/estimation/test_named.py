"""Estimators of others, by module and function."""

from __future__ import annotations

import pytest
from painted_poses import LAYOUT

from stcalib_ros.core.errors import InputError
from stcalib_ros.estimation.named import named_estimator


def test_one_of_your_own_is_what_the_function_returns():
    assert named_estimator("painted_poses:PaintedPoses").layout is LAYOUT


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("movnet", "no estimator of the name 'movnet': there are movenet"),
        ("no_such_module:load", "cannot be loaded: ModuleNotFoundError"),
        ("painted_poses:nobody", "cannot be loaded: AttributeError"),
        ("painted_poses:nothing", "returned a str, which has no layout of joints"),
        (":", "cannot be loaded: ValueError"),
    ],
)
def test_what_cannot_be_loaded_is_said_in_a_line(name, said):
    with pytest.raises(InputError, match=said) as caught:
        named_estimator(name)
    assert "\n" not in str(caught.value)
