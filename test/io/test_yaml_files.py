"""The one way in for YAML: plain data, within bounds, or an error of one line."""

from __future__ import annotations

import math
import os
from pathlib import Path

import pytest
import yaml

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.limits import MAX_YAML_DEPTH
from stcalib_ros.io.yaml_files import parse_yaml, read_yaml

SEVENFOLD = "".join(f", &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 9))
LAUGHS = f"[&a0 [x, x, x, x, x, x, x, x, x]{SEVENFOLD}]"
"""A text of 400 bytes that stands for 387 million values."""

MERGES = "b0: &b0 {k: 1}\n" + "".join(
    f"b{i}: &b{i} {{<<: [*b{i - 1}, *b{i - 1}]}}\n" for i in range(1, 28)
)


@pytest.mark.parametrize(
    "text",
    [
        "[1, -2, +3, 0x1F, 0b11, 017, 1_000, 0, -0]",
        "[1.5, -1.0e+3, .5, 6.8523015e+5, 1., 1e-5, 1.0e5, .]",
        "[~, '', yes, Off, TRUE, n, null, 'null', 'yes']",
        "[.inf, -.INF, +.Inf, 08, 0o17, 0x, a b, '1']",
        "[!!str 4, !!int 5, !!bool on, !!null ~]",
        "a: {b: [c, {d: e}]}\n1: x\n~: y\n",
        "base: &base {a: 1, b: [2]}\nmine: {<<: *base, a: 3}\nboth: {<<: [{a: 0}, *base], c: 4}",
        "a: &x [1, 2]\nb: *x\nc: [*x, *x]\n",
        "text: |\n  one\n  two\nfolded: >\n  one\n  two\n",
        "",
        "3",
        "- '<<'\n- a\n",
        "'<<': 1",
    ],
)
def test_plain_data_is_what_others_read(text: str) -> None:
    assert parse_yaml(text, "it") == yaml.safe_load(text)


def test_nan_and_dates() -> None:
    assert math.isnan(parse_yaml(".nan", "it"))
    assert parse_yaml("[2020-01-01, 1:30]", "it") == ["2020-01-01", "1:30"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\nb: 2\na: 3", r"'a' is given twice, line 3, column 4"),
        ("[1, 2", "not valid YAML"),
        ("!!bool x", "'x' with the tag 'tag:yaml.org,2002:bool' is none of plain data"),
        ("!!float ''", "'' with the tag"),
        ("!!int yes", "'yes' with the tag"),
        ("!!timestamp x", "with the tag"),
        ("!!python/object/apply:os.system ['true']", "the tag .* is none of plain data"),
        ("!!python/name:os.system", "with the tag"),
        ("!!set {a, b}", "the tag .*set' is none"),
        ("!!binary '@'", "with the tag"),
        ("!!map [a]", "the tag"),
        ("!!seq {a: b}", "the tag"),
        ("!!opencv-matrix {rows: 1}", "the tag"),
        ("&a [*a]", "no anchor 'a' to repeat"),
        ("<<: 1", "<< takes a mapping"),
        ("? [1]\n: 2", "cannot be a key"),
        ("a: 1\n---\nb: 2", "several documents"),
        ("0x_: 1", "not valid YAML"),
        ("[" * (MAX_YAML_DEPTH + 1), "levels deep"),
        ("[" * 20_000, "not valid YAML"),
        ("- " * 20_000, "levels deep"),
        (LAUGHS, "more than 1000000 values"),
        (MERGES, "more than 1000000 values"),
    ],
)
def test_everything_else_is_refused_in_one_line(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        parse_yaml(text, "scale.distances")
    assert str(caught.value).startswith("scale.distances is not valid YAML")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


def test_many_keys_take_no_more_than_their_number() -> None:
    content = parse_yaml("".join(f"k{i}: {i}\n" for i in range(30_000)), "it")
    assert len(content) == 30_000


def test_bounds_of_the_caller() -> None:
    assert parse_yaml("[1, 2]", "it", max_length=6, max_nodes=3) == [1, 2]
    with pytest.raises(InputError, match="it has 7 characters, and at most 6"):
        parse_yaml("[1,  2]", "it", max_length=6)
    with pytest.raises(InputError, match="more than 3 values"):
        parse_yaml("[1, 2, 3]", "it", max_nodes=3)
    assert parse_yaml("!!opencv-matrix {a: 1}", "it", mapping_tags=["opencv-matrix"]) == {"a": 1}


def test_long_digits_are_text() -> None:
    assert parse_yaml("9" * 5000, "it") == "9" * 5000
    assert parse_yaml("1" + ":59" * 5000, "it") == "1" + ":59" * 5000


def test_files_that_are_none(tmp_path: Path) -> None:
    for path, message in (
        (tmp_path / "absent.yaml", "no such file"),
        (tmp_path, "Is a directory"),
        (tmp_path / f"{'x' * 300}.yaml", "File name too long"),
        (tmp_path / "nul\0.yaml", "cannot read"),
    ):
        with pytest.raises(InputError, match=message):
            read_yaml(path)
    if os.path.exists("/dev/zero"):
        with pytest.raises(InputError, match="more than 32000000 bytes"):
            read_yaml(Path("/dev/zero"))
