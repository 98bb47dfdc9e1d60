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
    return subprocess.run(
        [checkout / "scripts/setup.sh", kind],
        env={"PATH": str(programs), "HOME": str(checkout), "PIP_NO_INDEX": "1"},
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )


def refusal(checkout: Path, programs: Path, kind: str) -> str:
    """What a setup says that stops before it has made anything."""
    done = setup(checkout, programs, kind)
    assert done.returncode == 2, done.stdout
    assert not list(checkout.glob(".venv*"))
    return done.stderr


def install_command(packages: str) -> str:
    return f"{'' if os.getuid() == 0 else 'sudo '}apt-get install {packages}"


@pytest.mark.parametrize("script", [None, "exit 1"], ids=["absent", "too old"])
def test_python(checkout, programs, script):
    if script:
        program(programs, "python3", f'[ "$1" = -V ] && echo Python 3.8.1 && exit; {script}')
    said = refusal(checkout, programs, "core")
    assert "missing: Python 3.10 or newer" in said
    assert install_command("python3 python3-venv python3-dev") in said
    assert ("3.8.1" in said) is bool(script)


def test_venv(checkout, programs):
    base_python(programs, refuses="ensurepip")
    said = refusal(checkout, programs, "core")
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
    said = refusal(checkout, programs, "jazzy")
    assert f"missing: {named}\n" in said
    assert install_command(package) in said


def test_headers(checkout, programs):
    base_python(programs, refuses="Python.h")
    for name in ("c++", "cc", "make"):
        program(programs, name, "exit 0")
    said = refusal(checkout, programs, "jazzy")
    assert "missing: Python.h, the headers of Python 3." in said
    assert install_command("python3-dev") in said


@pytest.mark.parametrize("kind", ["humble", ""])
def test_an_unknown_distribution(checkout, programs, kind):
    base_python(programs)
    said = refusal(checkout, programs, kind)
    assert f"unknown ROS distribution '{kind}': there are jazzy and kilted" in said


@pytest.fixture
def installs(checkout: Path, programs: Path) -> Path:
    """Lists what was installed: a Python whose environments only note what pip is asked for."""
    log = checkout / "pip.log"
    environment = f"""
    mkdir -p "$3/bin"
    printf '#!%s\\n' {shutil.which("bash")} >"$3/bin/python"
    echo '[ -e {checkout}/offline ] && exit 1; echo "$*" >>{log}' >>"$3/bin/python"
    chmod +x "$3/bin/python"
    """
    script = f"""
    [[ "$*" == *sys.executable* ]] && echo "$0" && exit
    [[ "$*" == "-m venv "* ]] || exec {sys._base_executable} "$@"
    {environment}
    """
    program(programs, "python3", script)
    for name in ("chmod", "mkdir"):
        (programs / name).symlink_to(str(shutil.which(name)))
    return log


def test_it_is_done_once(checkout, programs, installs):
    for _ in range(2):
        assert setup(checkout, programs, "core").returncode == 0
    lists = "--requirement=requirements/core.txt --requirement=requirements/report.txt"
    assert installs.read_text().splitlines() == [
        f"-m pip install --quiet {lists}",
        "-m pip install --quiet --no-deps --editable .",
    ]


def test_it_is_done_again_when_a_requirement_changes(checkout, programs, installs):
    setup(checkout, programs, "core")
    with (checkout / "requirements/core.txt").open("a") as file:
        file.write("another\n")
    left = checkout / ".venv/left"
    left.touch()
    assert setup(checkout, programs, "core").returncode == 0
    assert len(installs.read_text().splitlines()) == 4
    assert not left.exists()


def test_one_that_was_interrupted_is_done_again(checkout, programs, installs):
    (checkout / "offline").touch()
    failed = setup(checkout, programs, "core")
    assert failed.returncode == 2
    assert "could not install the packages of requirements/core.txt" in failed.stderr
    (checkout / "offline").unlink()
    assert setup(checkout, programs, "core").returncode == 0
    assert len(installs.read_text().splitlines()) == 2


def test_cmake_is_installed_only_where_there_is_none(checkout, programs, installs):
    for name in ("c++", "cc", "make"):
        program(programs, name, "exit 0")
    setup(checkout, programs, "jazzy")
    assert "cmake" in installs.read_text().split("requirements/ros-jazzy.txt")[1]
    program(programs, "cmake", "exit 0")
    (checkout / ".venv-jazzy/.complete").unlink()
    setup(checkout, programs, "jazzy")
    assert "cmake" not in installs.read_text().splitlines()[1]
