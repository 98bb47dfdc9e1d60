"""Bags that are written are those of ROS 2, whole or not there."""

from __future__ import annotations

from pathlib import Path

import bag_helpers as bags
import pytest
import yaml
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.bag_writer import require_bag_writable, write_bag


def test_metadata_is_in_the_form_of_rosbag2(tmp_path: Path) -> None:
    write_bag(bags.small_recording(), tmp_path / "walk")
    content = yaml.safe_load((tmp_path / "walk" / "metadata.yaml").read_text())
    info = content["rosbag2_bagfile_information"]
    assert info["relative_file_paths"] == ["walk_0.mcap"]
    assert info["message_count"] == 12
    counts = {
        t["topic_metadata"]["name"]: t["message_count"] for t in info["topics_with_message_count"]
    }
    assert counts["/cam0/person_poses"] == 5
    assert counts["/cam0/camera_info"] == 1
    assert info["starting_time"]["nanoseconds_since_epoch"] == bags.START_NS + 123_456_789
    assert info["duration"]["nanoseconds"] == 123_456_789 + 4 * 33_333_333


def test_written_bag_is_a_ros2_bag(tmp_path: Path) -> None:
    write_bag(bags.small_recording(1), tmp_path / "a.mcap")
    with (tmp_path / "a.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()], validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        decoded = list(reader.iter_decoded_messages())
    assert {d.schema.encoding for d in decoded} == {"ros2msg"}
    assert all("offered_qos_profiles" in d.channel.metadata for d in decoded)
    poses = next(d.decoded_message for d in decoded if d.channel.topic == "/cam0/person_poses")
    assert poses.header.frame_id == "cam0_optical_frame"
    assert poses.layout == "h36m_17"
    assert len(poses.persons) == 2
    assert len(poses.persons[0].joints) == 51
    lens = next(d.decoded_message for d in decoded if d.channel.topic == "/cam0/camera_info")
    assert (lens.width, lens.height, lens.distortion_model) == (640, 480, "plumb_bob")
    assert list(lens.p) == [800, 0, 320, 0, 0, 810, 240, 0, 0, 0, 1, 0]


def test_camera_info_is_repeated_every_second(tmp_path: Path) -> None:
    write_bag(bags.small_recording(1, n_frames=100), tmp_path / "walk")
    text = (tmp_path / "walk" / "metadata.yaml").read_text()
    topics = yaml.safe_load(text)["rosbag2_bagfile_information"]["topics_with_message_count"]
    assert topics[0]["topic_metadata"]["name"] == "/cam0/camera_info"
    assert topics[0]["message_count"] == 4


def test_nothing_is_left_of_an_interrupted_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "bag.mcap").write_text("old")

    def interrupt(*args: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Writer, "finish", interrupt)
    for name in ("bag.mcap", "bag"):
        with pytest.raises(KeyboardInterrupt):
            write_bag(bags.small_recording(), tmp_path / name)
    assert [p.name for p in tmp_path.iterdir()] == ["bag.mcap"]
    assert (tmp_path / "bag.mcap").read_text() == "old"


@pytest.mark.parametrize("name", ["a.mp4", "walk.bag", "walk.yaml"])
def test_names_of_other_files_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"ends in \.mcap, or that of a bag folder has no ending"):
        require_bag_writable(tmp_path / name)
    require_bag_writable(tmp_path / "walk_0.1")
