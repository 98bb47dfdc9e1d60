"""After make env, the shell of scripts/activate.sh has the commands that the documentation uses."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

import stcalib_ros


def in_shell(root: Path, command: str) -> subprocess.CompletedProcess[str]:
    distro = os.environ.get("ROS_DISTRO", "jazzy")
    if not (root / f".ros/{distro}/install/setup.bash").exists():
        pytest.skip("not built: make env")
    return subprocess.run(
        ["bash", "-c", f'source "{root}/scripts/activate.sh" {distro}; cd /; {command}'],
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )


@pytest.mark.parametrize("command", ["stcalib", "ros2 run stcalib_ros stcalib"])
def test_the_commands_are_there(root: Path, command: str) -> None:
    done = in_shell(root, f"{command} --version")
    assert (done.returncode, done.stdout) == (0, f"stcalib {stcalib_ros.__version__}\n"), (
        done.stderr
    )


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("ros2 topic list", "has only: ros2 run PACKAGE EXECUTABLE"),
        ("ros2 run stcalib_ros absent", "no executable absent of package stcalib_ros"),
    ],
)
def test_what_is_not_there_is_said(root: Path, command: str, said: str) -> None:
    done = in_shell(root, command)
    assert done.returncode == 2
    assert said in done.stderr
