"""Messages that are damaged in every way, into the buffers of the live node; without ROS."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from fuzzing import attack, corpus, of_bytes, taken

from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.assemble import assemble_recording
from stcalib_ros.io.bag_source import raw_messages
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.topics import SelectedCamera
from stcalib_ros.ros.buffers import Buffers
from stcalib_ros.ros.intake import Intake
from stcalib_ros.ros.load import Meter
from stcalib_ros.ros.streams import Limits

CAMERA = SelectedCamera("cam0", "/cam0/person_poses", "/cam0/camera_info", None)


class Door:
    """An intake that has seen good messages and goes on to see others."""

    def __init__(self, good: list[bytes], info: bytes) -> None:
        self.lines: list[str] = []
        limits = Limits(max_mb=1.0)
        self.buffers = Buffers([CAMERA], limits, lambda _about, line: self.lines.append(line))
        intake = Intake([CAMERA], self.buffers, Meter())
        self.poses, self.info = intake.poses_of(CAMERA), intake.info_of(CAMERA)
        self.n = 0
        self.take(self.info, info)
        for data in good:
            self.take(self.poses, data)

    def take(self, into: object, data: bytes) -> None:
        self.n += 1
        into(data, {"publication_sequence_number": self.n, "received_timestamp": self.n})  # type: ignore[operator]

    def __call__(self, data: bytes) -> None:
        self.take(self.poses, data)
        self.take(self.info, data)
        counts = self.buffers.counts()["cam0"]
        assert len(counts.last_problem) < 1000
        assert counts.last_problem.isprintable() or not counts.last_problem
        if self.n % 500 == 0:
            self.buffers.moving()
            self.buffers.snapshot()


@pytest.fixture(scope="module")
def messages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[bytes]]:
    path: Path = tmp_path_factory.mktemp("bag") / "walk.mcap"
    write_bag(simulate(SceneOptions(n_cameras=1, n_people=2, n_frames=40, seed=1)).recording, path)
    topics = (CAMERA.pose_topic, CAMERA.info_topic)
    return {t: [m.data for m in raw_messages([path], frozenset({t}))] for t in topics}


@pytest.fixture
def door(messages: dict[str, list[bytes]]) -> Door:
    return Door(messages[CAMERA.pose_topic], messages[CAMERA.info_topic][0])


def test_mutants(door: Door, messages: dict[str, list[bytes]], tmp_path: Path) -> None:
    seeds = [*messages[CAMERA.pose_topic], *messages[CAMERA.info_topic]]
    attack(door, of_bytes(seeds, random.Random(1)), tmp_path / "mutant")
    (images,) = door.buffers.snapshot()
    assert len(images.images) > 0
    assemble_recording([images], warn=lambda _: None)


@pytest.mark.parametrize("path", corpus("message"))
def test_what_once_did_harm(door: Door, path: Path) -> None:
    before = door.buffers.counts()["cam0"]
    assert taken(door, path.read_bytes())
    after = door.buffers.counts()["cam0"]
    assert (after.images, after.dropped) == (before.images, before.dropped + 2)
