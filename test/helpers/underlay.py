"""Small packages of the messages of others, built with colcon, for they have no wheels."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterable
from pathlib import Path

import pytest

from stcalib_ros.io.message_types import TYPES

ROOT = Path(__file__).parents[2]
HERE = ROOT / "test/ros/underlay"
"""tf2_msgs, whose CMakeLists.txt and package.xml serve for all."""


def built_underlay() -> Path:
    """Build all packages in one call; return the file to be sourced for them.

    The definitions are those of `TYPES`; their fields are those of the packages' own files.
    """
    if shutil.which("colcon") is None or "VIRTUAL_ENV" not in os.environ:
        pytest.skip("needs colcon: make env, then source scripts/activate.sh")
    folder, venv = ROOT / ".ros" / f"{os.environ['ROS_DISTRO']}-underlay", os.environ["VIRTUAL_ENV"]
    for package in ("hri_msgs", "yolo_msgs", "zed_msgs"):
        _write_package(folder / "src", package)
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [
            *("colcon", "--log-base", folder / "log", "build"),
            *("--base-paths", HERE, folder / "src"),
            *("--build-base", folder / "build", "--install-base", folder / "install"),
            *("--cmake-args", "-DBUILD_TESTING=OFF"),
            f"-DPython3_EXECUTABLE={venv}/bin/python3",
        ],
        env=environment | {"AMENT_PREFIX_PATH": venv, "CMAKE_PREFIX_PATH": venv},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder / "install" / "local_setup.bash"


def _write_package(source: Path, package: str) -> None:
    """Write a package with our definitions of its messages."""
    folder, texts = source / package, dict(_definitions(package))
    for name, text in texts.items():
        _write(folder / "msg" / f"{name}.msg", text)
    for template in ("CMakeLists.txt", "package.xml"):
        text = (HERE / "tf2_msgs" / template).read_text()
        text = text.replace("tf2_msgs", package).replace("Stands in for", "Messages of")
        _write(
            folder / template,
            text.replace("msg/TFMessage.msg", " ".join(f"msg/{name}.msg" for name in texts)),
        )


def _definitions(package: str) -> Iterable[tuple[str, str]]:
    for name, known in TYPES.items():
        if name.startswith(f"{package}/msg/"):
            yield name.rpartition("/")[2], known.definition()
            for part in known.dependencies:
                if part.name.startswith(f"{package}/"):
                    yield part.name.rpartition("/")[2], part.text()


def _write(path: Path, text: str) -> None:
    """Leave a file as it is that has this text already: what was built of it is kept."""
    if not path.exists() or path.read_text() != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
