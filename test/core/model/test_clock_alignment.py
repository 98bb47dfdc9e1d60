"""What the option ``align`` can say."""

from __future__ import annotations

import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.clock_alignment import ClockAlignment, clock_alignment
from stcalib_ros.core.options import Options, options_from_mapping


@pytest.mark.parametrize("word", ["auto", "starts", "stamps"])
def test_words(word: str) -> None:
    assert clock_alignment(word) == ClockAlignment(word)


def test_seconds() -> None:
    assert clock_alignment("-3600.5") == ClockAlignment(others_s=-3600.5)
    assert clock_alignment("a=1, site/b=-2e3").cameras_s == {"a": 1.0, "site/b": -2000.0}
    assert options_from_mapping({"align": -3600}).align == "-3600"


@pytest.mark.parametrize("text", ["", "start", "nan", "1e10", "=1", "a=", "a=1,b", "inf", "1 s"])
def test_what_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"option align must be auto, starts, .* got '") as caught:
        Options(align=text)
    assert "\n" not in str(caught.value)
