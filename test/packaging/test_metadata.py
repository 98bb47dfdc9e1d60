"""What several files must agree on: versions, dependencies, interfaces."""

from __future__ import annotations

import ast
import re
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import stcalib_ros

ROS_KEYS = {"opencv-python-headless": "python3-opencv", "PyYAML": "python3-yaml"}
OF_BAGS = {"mcap", "lz4", "zstandard"}
"""Without a key of a Debian package: the README says how to install mcap, which brings these."""


def requirements(path: Path) -> set[str]:
    lines = (line.split("#")[0].strip() for line in path.read_text().splitlines())
    return {re.split("[<>=!~]", line)[0].strip() for line in lines if line}


def test_one_version(root):
    version = stcalib_ros.__version__
    assert ET.parse(root / "package.xml").findtext("version") == version
    assert f"## {version}" in (root / "CHANGELOG.md").read_text()


def test_one_licence(root):
    assert ET.parse(root / "package.xml").findtext("license") == "Apache-2.0"
    assert 'license = { text = "Apache-2.0" }' in (root / "pyproject.toml").read_text()
    assert (
        "Apache License\n                           Version 2.0" in (root / "LICENSE").read_text()
    )


def test_what_pip_installs_is_what_rosdep_installs(root):
    names = requirements(root / "requirements/core.txt") | requirements(
        root / "requirements/report.txt"
    )
    names -= OF_BAGS | {
        "tomli"
    }  # the latter is of Python 3.10, which no distribution of ROS that we build for has
    wanted = {ROS_KEYS.get(name, f"python3-{name}") for name in names}
    tags = ET.parse(root / "package.xml").getroot().iter("exec_depend")
    pip_keys = {t.text for t in tags if t.text and "-" in t.text}
    assert pip_keys == wanted
    assert "pip install --user --break-system-packages mcap" in (root / "README.md").read_text()


def test_cmake_generates_every_interface_and_knows_every_package_it_uses(root):
    cmake = (root / "CMakeLists.txt").read_text()
    files = [p for folder in ("msg", "srv", "action") for p in (root / folder).iterdir()]
    listed = set(re.findall(r"^  ((?:msg|srv|action)/\S+)$", cmake, re.MULTILINE))
    assert listed == {p.relative_to(root).as_posix() for p in files}
    used = {m for p in files for m in re.findall(r"^(\w+)/\w+", p.read_text(), re.MULTILINE)}
    match = re.search("  DEPENDENCIES (.*)", cmake)
    assert match is not None
    assert set(match[1].split()) == used - {"stcalib_ros"}
    declared = {t.text for t in ET.parse(root / "package.xml").getroot().iter("depend")}
    assert declared == used - {"stcalib_ros"}


def test_no_module_hides_generated_ones(root):
    hidden = [p for p in (root / "stcalib_ros").iterdir() if p.stem in ("msg", "srv", "action")]
    assert not hidden


def test_every_import_is_declared(root):
    """Of the package: the standard library, pip requirements, and ROS under ros/ alone."""
    allowed = {"cv2", "yaml", "stcalib_ros", *sys.stdlib_module_names}
    allowed |= {n.replace("-", "_") for n in requirements(root / "requirements/core.txt")}
    allowed |= requirements(root / "requirements/report.txt")
    ros = {
        t.text
        for tag in ("depend", "exec_depend")
        for t in ET.parse(root / "package.xml").getroot().iter(tag)
    }
    for path in (root / "stcalib_ros").rglob("*.py"):
        within_ros = path.is_relative_to(root / "stcalib_ros/ros")
        unknown = imported(path) - allowed - (ros if within_ros else set())
        if path.is_relative_to(root / "stcalib_ros/estimation"):
            unknown -= requirements(root / "requirements/movenet.txt")
        assert not unknown, f"{path}: {unknown}"


def test_the_core_knows_no_ros_no_files_and_no_plots(root):
    for path in (root / "stcalib_ros/core").rglob("*.py"):
        text = path.read_text()
        assert not re.search(r"stcalib_ros\.(io|ros|report|cli)\b", text), path
        assert not imported(path) & {"rclpy", "mcap", "mcap_ros2", "yaml", "matplotlib"}, path


def imported(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {a.name.split(".")[0] for a in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module.split(".")[0])
    return names
