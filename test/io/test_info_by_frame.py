"""A driver in one namespace, the pose estimator in another: the frame says what they share."""

from __future__ import annotations

import pytest
from bag_helpers import CAMERA_INFO, POSES, START_NS, header, info, poses, write_bag

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.bag import read_bag


def bag_of(tmp_path, *infos: tuple[str, str], others: tuple[str, ...] = ()):
    """Camera a, and others, in frame "lens"; and a CameraInfo on each topic, in its frame."""
    lenses = [
        (topic, CAMERA_INFO, info(header=header(START_NS, frame), width=640 + k), START_NS)
        for k, (topic, frame) in enumerate(infos)
    ]
    image = poses(0, header=header(START_NS, "lens"))
    seen = [(topic, POSES, image, START_NS) for topic in ("/a/person_poses", *others)]
    return write_bag(tmp_path / "a.mcap", [*seen, *lenses])


def test_the_lens_in_the_frame_of_the_poses_is_taken(tmp_path):
    bag = bag_of(tmp_path, ("/x/camera_info", "other"), ("/y/camera_info", "lens"))
    assert read_bag(bag).cameras[0].intrinsics.width == 641


def test_it_does_not_serve_two_cameras(tmp_path):
    bag = bag_of(tmp_path, ("/b/camera_info", "lens"), others=("/b/person_poses",))
    with pytest.raises(InputError, match="camera a: no CameraInfo on /a/camera_info"):
        read_bag(bag)
    bag = bag_of(tmp_path, ("/x/camera_info", "lens"), others=("/b/person_poses",))
    with pytest.raises(InputError, match="camera a: no CameraInfo on /a/camera_info"):
        read_bag(bag)


def test_names_come_before_frames(tmp_path):
    bag = bag_of(tmp_path, ("/a/camera_info", "other"), ("/y/camera_info", "lens"))
    assert read_bag(bag).cameras[0].intrinsics.width == 640


@pytest.mark.parametrize("frames", [("other",), ("lens", "lens"), ("",)])
def test_none_and_several_are_not_guessed(tmp_path, frames):
    bag = bag_of(tmp_path, *((f"/{k}/camera_info", frame) for k, frame in enumerate(frames)))
    with pytest.raises(InputError, match=r"camera a: no CameraInfo on /a/camera_info: .* name its"):
        read_bag(bag)
