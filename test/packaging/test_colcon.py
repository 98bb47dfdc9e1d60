"""`colcon build`, plain and with --symlink-install: what a workspace then has."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

import stcalib_ros
from stcalib_ros.core.model.calibration import Status

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        shutil.which("colcon") is None or "VIRTUAL_ENV" not in os.environ,
        reason="needs ROS 2 and colcon: make env, then source scripts/activate.sh",
    ),
]


@pytest.fixture(scope="module", params=["plain", "symlink"])
def install(request: pytest.FixtureRequest, root: Path) -> tuple[Path, bool]:
    """Install folder of an up-to-date build, and whether its files are links to the sources."""
    distro = os.environ["ROS_DISTRO"]
    symlink = request.param == "symlink"
    folder = root / ".ros" / (distro if symlink else f"{distro}-plain")
    options = ["--symlink-install"] if symlink else []
    command = [root / "scripts/build.sh", distro, folder, *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder / "install", symlink


def run(install: Path, *command: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run in a shell that has sourced nothing but ROS and the workspace."""
    clean = 'unset PYTHONPATH COLCON_CURRENT_PREFIX; export AMENT_PREFIX_PATH="$VIRTUAL_ENV"'
    script = f'{clean}; source "{install}/local_setup.bash"; exec "$@"'
    return subprocess.run(
        ["bash", "-c", script, "bash", *command],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )


def package_folder(install: Path) -> Path:
    (folder,) = install.glob("stcalib_ros/lib/python3*/*-packages/stcalib_ros")
    return folder


def test_modules_are_there_once_copied_once_linked(root, install):
    folder, symlink = install
    installed = package_folder(folder)
    sources = sorted(p for p in (root / "stcalib_ros").rglob("*.py"))
    for source in sources:
        copy = installed / source.relative_to(root / "stcalib_ros")
        assert copy.is_symlink() is symlink, copy
        assert copy.read_text() == source.read_text(), copy
    assert not list(installed.glob("definitions/*.py"))


def test_message_definitions_are_those_of_the_sources(root, install, tmp_path):
    code = "import stcalib_ros.msgdefs as m; print(m.__file__); print(m.definition('TimeOffset'))"
    done = run(install[0], "python3", "-c", code, cwd=tmp_path)
    file, _, text = done.stdout.partition("\n")
    assert Path(file).parent == package_folder(install[0]), done.stderr
    assert text == (root / "msg/TimeOffset.msg").read_text() + "\n"


def test_messages_and_modules_live_in_one_package(install, tmp_path):
    code = (
        "from stcalib_ros.msg import CalibrationResult as R\n"
        "import stcalib_ros.action, stcalib_ros.ros.convert, stcalib_ros.srv\n"
        "print(R.OK, R.DEGENERATE, R.INSUFFICIENT_DATA, R.NOT_CONVERGED, R.CANCELLED)"
    )
    done = run(install[0], "python3", "-c", code, cwd=tmp_path)
    assert done.stdout.split() == [str(int(s)) for s in Status], done.stderr


def test_interfaces_and_configuration_are_shared(root, install):
    share = install[0] / "stcalib_ros/share/stcalib_ros"
    for name in ("msg/CalibrationResult.msg", "srv/Recalibrate.srv", "action/Calibrate.action"):
        assert (share / name).read_text() == (root / name).read_text()
    configuration = [path for path in (root / "config").rglob("*") if path.is_file()]
    for source in (*configuration, *(root / "launch").glob("*.py")):
        assert (share / source.relative_to(root)).read_text() == source.read_text()


def test_executables_are_where_ros2_run_looks(root, install, tmp_path):
    executables = install[0] / "stcalib_ros/lib/stcalib_ros"
    assert {p.name for p in executables.iterdir()} == {p.name for p in (root / "bin").iterdir()}
    said = run(install[0], str(executables / "stcalib"), "--version", cwd=tmp_path)
    assert said.stdout.split() == ["stcalib", stcalib_ros.__version__], said.stderr
    refused = run(
        install[0], str(executables / "replay"), "no.mcap", "-o", "out.yaml", cwd=tmp_path
    )
    assert refused.returncode == 2
    assert "no.mcap" in refused.stderr
    assert "Traceback" not in refused.stderr
    assert not list(tmp_path.iterdir())
