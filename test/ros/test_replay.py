"""`replay` is `stcalib calibrate` with ROS's deserialiser: same numbers, same file."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
from collections.abc import Iterator
from enum import Enum
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.mocap import shipped_clips
from stcalib_ros.ros.convert import decode

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bag") / "walk.mcap"
    options = SceneOptions(n_cameras=3, n_people=2, n_frames=200, seed=1)
    write_bag(simulate(options, clips=shipped_clips()).recording, path)
    return path


def replay_executable() -> Path:
    prefixes = os.environ["AMENT_PREFIX_PATH"].split(os.pathsep)
    found = (Path(p) / "lib/stcalib_ros/replay" for p in prefixes)
    return next(path for path in found if path.exists())


def run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL
    )


def leaves(record: object, path: str = "") -> Iterator[tuple[str, object]]:
    """All numbers and texts in a record, with where they are."""
    if dataclasses.is_dataclass(record):
        for field in dataclasses.fields(record):
            yield from leaves(getattr(record, field.name), f"{path}.{field.name}")
    elif isinstance(record, tuple | list):
        for i, item in enumerate(record):
            yield from leaves(item, f"{path}[{i}]")
    else:
        yield path, record.value if isinstance(record, Enum) else record


def test_both_deserialisers_give_the_same_recording(bag):
    plain, ros = dict(leaves(read_bag(bag))), dict(leaves(read_bag(bag, decoder=decode)))
    assert plain.keys() == ros.keys()
    assert sum(np.size(value) for value in plain.values()) > 50_000
    for path, value in plain.items():
        np.testing.assert_array_equal(ros[path], value, err_msg=path)


def test_replay_writes_the_file_that_stcalib_writes(bag, tmp_path):
    offline = run(
        *(sys.executable, "-m", "stcalib_ros", "calibrate", bag),
        *("--output", tmp_path / "offline.yaml", "--quiet"),
        cwd=ROOT,
    )
    assert offline.returncode == 0, offline.stderr
    replayed = run(
        *(replay_executable(), bag, "--output", "replayed.yaml", "--quiet"),
        *("--ros-args", "--log-level", "info"),
        cwd=tmp_path,
    )
    assert replayed.returncode == 0, replayed.stderr
    expected = (tmp_path / "offline.yaml").read_text()
    assert (tmp_path / "replayed.yaml").read_text() == expected
    assert "status: OK" in expected


def test_what_replay_cannot_read_it_says_in_one_line(tmp_path):
    done = run(replay_executable(), "absent.mcap", "--output", "out.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert "absent.mcap" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_without_ros_replay_says_what_to_do(root_without_ros):
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            "import sys; from stcalib_ros.ros.replay import main; sys.exit(main())",
        ],
        env=os.environ | {"PYTHONPATH": str(root_without_ros)},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr == (
        "replay: no module 'rclpy': source the workspace's install/setup.bash, "
        "or use `stcalib calibrate`, which needs no ROS\n"
    )


@pytest.fixture
def root_without_ros(tmp_path: Path) -> Path:
    """A folder that, first on the path, makes rclpy impossible to import."""
    (tmp_path / "rclpy.py").write_text(
        "raise ModuleNotFoundError('No module named rclpy', name='rclpy')\n"
    )
    return tmp_path
