"""What is not installed is named with the command that installs it."""

from __future__ import annotations

import sys

import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.estimation.registry import ESTIMATORS, load_estimator


@pytest.mark.parametrize("name", ESTIMATORS)
def test_a_missing_package_is_one_line_with_the_command(name, monkeypatch):
    monkeypatch.setitem(sys.modules, ESTIMATORS[name].packages[0], None)
    with pytest.raises(InputError) as error:
        load_estimator(name)
    assert f'pip install "stcalib-ros[{ESTIMATORS[name].extra}]"' in str(error.value)
    assert ESTIMATORS[name].packages[0] in str(error.value)
    assert "\n" not in str(error.value)


def test_an_unknown_estimator_is_named_with_those_that_there_are():
    with pytest.raises(InputError, match="'posenet': there are movenet, blazepose, rtmo, rtmpose"):
        load_estimator("posenet")
