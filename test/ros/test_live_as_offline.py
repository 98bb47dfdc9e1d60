"""The same messages give the same recording, be they read from a bag or received live."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bag_helpers import assert_same, camera, info, poses, write_bag
from plain import Ear

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.io.assemble import assemble_recording
from stcalib_ros.io.bag import open_bag, read_bag
from stcalib_ros.io.bag_source import raw_messages
from stcalib_ros.ros.buffers import Buffers
from stcalib_ros.ros.intake import Intake
from stcalib_ros.ros.load import Meter
from stcalib_ros.ros.streams import Limits

FISHEYE = {"distortion_model": "double_sphere", "d": [0.1] * 6}
"""D that nobody here understands beside a P that is all that rectified images need."""
NO_K = {"k": [0.0] * 9}
NO_P = {"p": [0.0] * 12}
BAD_P = {"p": [-1.0] * 12}


def bag_of(folder: Path, *, rectified: bool, **changes: object) -> Path:
    first, *images = camera(images=[poses(k, rectified=rectified) for k in range(3)])
    topic, kind, _, stamp = first
    return write_bag(folder / "walk.mcap", [(topic, kind, info(**changes), stamp), *images])


def received(bag: Path, *, info_last: bool) -> tuple[Buffers, Ear]:
    """The buffers after all messages of a bag have arrived."""
    files, cameras = open_bag(bag)
    ear = Ear()
    buffers = Buffers(cameras, Limits(), ear)
    intake = Intake(cameras, buffers, Meter())
    takes = {c.pose_topic: intake.poses_of(c) for c in cameras}
    takes |= {c.info_topic: intake.info_of(c) for c in cameras}
    messages = list(raw_messages(files, frozenset(takes)))
    messages.sort(key=lambda m: m.topic.endswith("camera_info") == info_last)
    for number, message in enumerate(messages):
        about = {"publication_sequence_number": number, "received_timestamp": message.log_time}
        takes[message.topic](message.data, about)
    return buffers, ear


def recorded(buffers: Buffers) -> Recording:
    return assemble_recording(buffers.snapshot(), warn=pytest.fail)


@pytest.mark.parametrize("info_last", [False, True])
@pytest.mark.parametrize(("rectified", "changes"), [(False, {}), (True, {}), (True, FISHEYE)])
def test_the_same_messages_give_the_same_recording(tmp_path, rectified, changes, info_last):
    bag = bag_of(tmp_path, rectified=rectified, **changes)
    buffers, ear = received(bag, info_last=info_last)
    assert ear.lines == []
    live, offline = recorded(buffers), read_bag(bag)
    assert_same(live, offline)
    assert live.cameras[0].intrinsics.K[0, 0] == 800.0
    assert np.isfinite(live.cameras[0].tracks[0].keypoints).all()


@pytest.mark.parametrize("info_last", [False, True])
@pytest.mark.parametrize(("rectified", "changes"), [(False, FISHEYE | NO_K), (True, NO_P)])
def test_without_a_lens_the_size_of_the_image_is_the_same(tmp_path, rectified, changes, info_last):
    bag = bag_of(tmp_path, rectified=rectified, **changes)
    buffers, ear = received(bag, info_last=info_last)
    assert ear.lines == []
    live, offline = recorded(buffers), read_bag(bag)
    assert_same(live, offline)
    assert not live.cameras[0].intrinsics.known


@pytest.mark.parametrize("info_last", [False, True])
@pytest.mark.parametrize(("rectified", "changes"), [(False, FISHEYE), (True, BAD_P)])
def test_the_same_messages_are_refused(tmp_path, rectified, changes, info_last):
    bag = bag_of(tmp_path, rectified=rectified, **changes)
    with pytest.raises(InputError) as offline:
        read_bag(bag)
    buffers, ear = received(bag, info_last=info_last)
    if info_last:
        assert buffers.snapshot() == []
        assert str(offline.value) in ear.lines[0]
    else:
        with pytest.raises(InputError) as live:
            recorded(buffers)
        assert str(live.value) == str(offline.value)
