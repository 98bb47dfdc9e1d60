"""Bags give the same numbers with and without ROS."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import bag_helpers as bags
import pytest

from stcalib_ros.core.model.recording import keypoints_only
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.bag_writer import write_bag

serialization = pytest.importorskip("rclpy.serialization")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built")


def decode(type_name: str, data: bytes) -> Any:
    package, _, name = type_name.split("/")
    kind = getattr(importlib.import_module(f"{package}.msg"), name)
    return serialization.deserialize_message(data, kind)


@pytest.mark.parametrize("cameras", [[], ["cam0"], ["cam0", "cam1"]])
def test_rclpy_reads_what_we_write_without_3d_poses(tmp_path: Path, cameras: list[str]) -> None:
    recording = keypoints_only(bags.small_recording(), cameras)
    write_bag(recording, tmp_path / "a.mcap")
    bags.assert_same(recording, read_bag(tmp_path / "a.mcap", decoder=decode))
    bags.assert_same(recording, read_bag(tmp_path / "a.mcap"))


@pytest.mark.parametrize("rectified", [False, True])
def test_rclpy_reads_what_we_write(tmp_path: Path, rectified: bool) -> None:
    recording = bags.small_recording(rectified=rectified)
    write_bag(recording, tmp_path / "a.mcap")
    bags.assert_same(recording, read_bag(tmp_path / "a.mcap", decoder=decode))
    bags.assert_same(recording, read_bag(tmp_path / "a.mcap"))


def test_messages_are_as_long_as_those_of_rclpy(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write_bag(bags.small_recording(), path)
    checked = set()

    def compare(type_name: str, data: bytes) -> Any:
        message = decode(type_name, data)
        again = serialization.serialize_message(message)
        # The contents of padding are arbitrary, and so are up to three bytes of it at the end.
        assert 0 <= len(again) - len(data) < 4
        checked.add(type_name)
        return message

    read_bag(path, decoder=compare)
    assert len(checked) == 2
