"""`pip install .`, by way of the source distribution: all of it is there, and works without ROS."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import stcalib_ros

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def installed(source_copy: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pip")
    build = "import sys; from setuptools import build_meta; build_meta.build_sdist(sys.argv[1])"
    run([sys.executable, "-c", build, str(folder)], cwd=source_copy)
    (sdist,) = folder.glob("*.tar.gz")
    options = ["--no-deps", "--no-build-isolation", "--quiet", "--disable-pip-version-check"]
    target = folder / "site"
    run([sys.executable, "-m", "pip", "install", *options, "--target", str(target), str(sdist)])
    return target


def run(command: list[str], **options) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stderr
    return done.stdout


def python(installed: Path, code: str, tmp_path: Path) -> str:
    """Output of a program that sees the installed package and nothing of the checkout or ROS."""
    return run(
        [sys.executable, "-c", code], cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(installed)}
    )


def test_the_message_definitions_are_there(root, installed, tmp_path):
    code = "import stcalib_ros.msgdefs as m; print(m.__file__); print(m.definition('TimeOffset'))"
    file, text = python(installed, code, tmp_path).split("\n", 1)
    assert Path(file) == installed / "stcalib_ros/msgdefs.py"
    assert text == (root / "msg/TimeOffset.msg").read_text() + "\n"


def test_every_file_of_the_package_is_there(root, installed):
    def files(folder: Path) -> set[str]:
        found = (p for p in folder.rglob("*") if p.is_file() and "__pycache__" not in p.parts)
        return {p.relative_to(folder).as_posix() for p in found}

    messages = {f"definitions/{p.name}" for p in (root / "msg").iterdir()}
    assert files(installed / "stcalib_ros") == files(root / "stcalib_ros") | messages


def test_the_command_is_there_and_needs_no_ros(installed, tmp_path):
    env = os.environ | {"PYTHONPATH": str(installed)}
    said = run([str(installed / "bin/stcalib"), "--version"], cwd=tmp_path, env=env)
    assert stcalib_ros.__version__ in said


def test_metadata_names_the_requirements(installed, tmp_path):
    code = "from importlib.metadata import requires; print(*requires('stcalib_ros'), sep='\\n')"
    needed = python(installed, code, tmp_path).splitlines()
    assert {n.split(";")[0].split("<")[0].split(">")[0].lower() for n in needed} >= {
        "numpy",
        "scipy",
        "opencv-python-headless",
        "mcap",
        "matplotlib",
    }
    assert all("extra ==" in n for n in needed if n.startswith(("matplotlib", "pytest")))
