"""``stcalib export --bag``: people among the cameras."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from core_helpers import SMALL

from stcalib_ros.cli import main
from stcalib_ros.core.synthetic import simulate
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.results import write_result


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("walk")
    scene = simulate(replace(SMALL, n_frames=90))
    write_bag(scene.recording, folder / "walk.mcap")
    write_result(scene.truth, folder / "walk.yaml")
    return folder


def export(folder: Path, form: str, output: str) -> int:
    result, bag = str(folder / "walk.yaml"), str(folder / "walk.mcap")
    return main(["export", result, "-f", form, "-o", str(folder / output), "--bag", bag])


def test_people_are_points_of_colmap(walk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert export(walk, "colmap", "sparse") == 0
    assert ", 2 people (metres)" in capsys.readouterr().out
    lines = (walk / "sparse" / "points3D.txt").read_text().splitlines()[1:]
    points = np.array([line.split() for line in lines], dtype=float)
    assert len(points) > 1000
    assert len({tuple(color) for color in points[:, 4:7]}) == 2


def test_people_are_figures_of_gltf(walk: Path) -> None:
    assert export(walk, "gltf", "walk.gltf") == 0
    content = json.loads((walk / "walk.gltf").read_text())
    assert [node["name"] for node in content["nodes"] if "mesh" in node] == ["person0", "person1"]


def test_a_format_without_a_place_for_people_says_which_have_one(
    walk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert export(walk, "kalibr", "chain.yaml") == 2
    said = capsys.readouterr().err
    assert "kalibr has no place for people, these have: colmap, gltf" in said
    assert not (walk / "chain.yaml").exists()
