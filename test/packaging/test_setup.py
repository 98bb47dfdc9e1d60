"""A missing prerequisite is named, with the command that installs it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

BASICS = ["bash", "cat", "cksum", "cut", "dirname", "env", "id", "printf", "rm", "sed", "tail"]


@pytest.fixture
def checkout(root: Path, tmp_path: Path) -> Path:
    copy = tmp_path / "checkout"
    shutil.copytree(root / "requirements", copy / "requirements")
    shutil.copytree(root / "scripts", copy / "scripts")
    return copy


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """A PATH of its own: what a bare system has, and Debian's package manager."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name in BASICS:
        found = shutil.which(name)
        assert found is not None, name
        (folder / name).symlink_to(found)
    program(folder, "apt-get", "exit 0")
    return folder


def program(folder: Path, name: str, script: str) -> None:
    path = folder / name
    path.write_text(f"#!{shutil.which('bash')}\n{script}\n")
    path.chmod(0o755)


def base_python(folder: Path, refuses: str = "nothing") -> None:
    """A Python that fails on a program with that word in it."""
    script = f"""
    [[ "$*" == *sys.executable* ]] && echo "$0" && exit
    [[ "$*" == *{refuses}* ]] && exit 1
    exec {sys._base_executable} "$@"
    """
    program(folder, "python3", script)


def setup(checkout: Path, programs: Path, kind: str) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [checkout / "scripts/setup.sh", kind],
        env={"PATH": str(programs), "HOME": str(checkout), "PIP_NO_INDEX": "1"},
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 2, done.stdout
    assert not list(checkout.glob(".venv*"))
    return done


def install_command(packages: str) -> str:
    return f"{'' if os.getuid() == 0 else 'sudo '}apt-get install {packages}"


@pytest.mark.parametrize("script", [None, "exit 1"], ids=["absent", "too old"])
def test_python(checkout, programs, script):
    if script:
        program(programs, "python3", f'[ "$1" = -V ] && echo Python 3.8.1 && exit; {script}')
    said = setup(checkout, programs, "core").stderr
    assert "missing: Python 3.10 or newer" in said
    assert install_command("python3 python3-venv python3-dev") in said
    assert ("3.8.1" in said) is bool(script)


def test_venv(checkout, programs):
    base_python(programs, refuses="ensurepip")
    said = setup(checkout, programs, "core").stderr
    assert "missing: the venv module of Python 3." in said
    assert install_command("python3-venv") in said


@pytest.mark.parametrize(
    ("there", "named", "package"),
    [
        ([], "a C++ compiler", "build-essential"),
        (["c++"], "a C compiler", "build-essential"),
        (["c++", "cc"], "make", "make"),
    ],
)
def test_compilers(checkout, programs, there, named, package):
    base_python(programs)
    for name in there:
        program(programs, name, "exit 0")
    said = setup(checkout, programs, "jazzy").stderr
    assert f"missing: {named}\n" in said
    assert install_command(package) in said


def test_headers(checkout, programs):
    base_python(programs, refuses="Python.h")
    for name in ("c++", "cc", "make"):
        program(programs, name, "exit 0")
    said = setup(checkout, programs, "jazzy").stderr
    assert "missing: Python.h, the headers of Python 3." in said
    assert install_command("python3-dev") in said


@pytest.mark.parametrize("kind", ["humble", ""])
def test_an_unknown_distribution(checkout, programs, kind):
    base_python(programs)
    said = setup(checkout, programs, kind).stderr
    assert f"unknown ROS distribution '{kind}': there are jazzy and kilted" in said
