from __future__ import annotations

from pathlib import Path

import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.config import Config, read_config
from stcalib_ros.io.topics import CameraSelection, CameraTopics, select_cameras


def test_everything(tmp_path: Path) -> None:
    text = """\
offset_range_s: 1
bundle: {rounds: 3}
cameras: [b, a]
camera:
  a: {pose_topic: /people, frame: lens}
"""
    (tmp_path / "c.yaml").write_text(text)
    config = read_config(tmp_path / "c.yaml")
    assert config.options.offset_range_s == 1.0
    assert config.options.bundle.rounds == 3
    assert config.selection.cameras == ("b", "a")
    assert config.selection.camera == {"a": CameraTopics("/people", None, "lens")}


def test_empty_file_is_the_default(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").touch()
    assert read_config(tmp_path / "c.yaml") == Config()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("- a", "expected NAME: VALUE lines"),
        ("offset_range: 1", "unknown option offset_range: did you mean offset_range_s"),
        ("cameras: a", r"cameras: expected a list of names, got 'a'"),
        ("cameras: [a, b, a]", "two cameras have the same name: a"),
        ("camera: [a]", "camera: expected a mapping"),
        ("camera: {a: /x}", r"camera\.a: expected pose_topic, .*, line_time_s, .*, got '/x'"),
        ("camera: {a: {topic: /x}}", r"unknown option camera\.a\.topic"),
        ("camera: {a: {frame: 3}}", r"camera\.a\.frame: expected text, got 3"),
        ("camera: {a: {line_time_s: fast}}", r"camera\.a\.line_time_s: expected seconds per image"),
        (
            "camera: {a: {line_time_s: true}}",
            r"line_time_s: expected .*, got True",
        ),
        ("camera: {a: {frame: x}, a: {frame: y}}", "'a' is given twice"),
    ],
)
def test_unusable(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_config(tmp_path / "c.yaml")
    assert "c.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["15e-6", "15.0e-6", "'1.5e-5'"])
def test_line_time(tmp_path: Path, text: str) -> None:
    (tmp_path / "c.yaml").write_text(f"camera: {{a: {{line_time_s: {text}}}}}")
    own = read_config(tmp_path / "c.yaml").selection
    assert own.camera["a"] == CameraTopics(line_time_s=15e-6)
    both = own.with_line_delays({"a": 2e-5, "b": 0.0})
    assert {name: one.line_time_s for name, one in both.camera.items()} == {"a": 2e-5, "b": 0.0}


def test_line_times_reach_the_cameras() -> None:
    selection = CameraSelection(None, {"a": CameraTopics(line_time_s=2e-5)})
    assert [camera.line_time_s for camera in select_cameras(TYPES, selection)] == [2e-5]


TYPES = {
    "/a/person_poses": "stcalib_ros/msg/PersonPose3DArray",
    "/a/camera_info": "sensor_msgs/msg/CameraInfo",
    "/a/image": "sensor_msgs/msg/Image",
}


@pytest.mark.parametrize(
    ("selection", "message"),
    [
        (
            CameraSelection(("a", "b")),
            r"no person poses of camera b; the bag has .*/a/person_poses",
        ),
        (
            CameraSelection(None, {"b": CameraTopics(line_time_s=1e-5)}),
            r"line_time_s of camera b: there are no person poses .* bag has .*/a/person_poses",
        ),
        (
            CameraSelection(None, {"b": CameraTopics("/a/image")}),
            r"camera b: no person poses on /a/image: its type is sensor_msgs/msg/Image",
        ),
        (
            CameraSelection(None, {"a": CameraTopics(None, "/lens")}),
            r"no CameraInfo on /lens: there is no such topic; the bag has .* on /a/camera_info",
        ),
    ],
)
def test_topics_that_are_not_there(selection: CameraSelection, message: str) -> None:
    with pytest.raises(InputError, match=message):
        select_cameras(TYPES, selection)
