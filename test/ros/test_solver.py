"""The solver in a process of its own; without ROS."""

from __future__ import annotations

import multiprocessing
import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stcalib_ros.core.errors import Cancelled, InputError
from stcalib_ros.core.options import Options
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.assemble import CameraImages, assemble_recording
from stcalib_ros.io.bag_source import raw_messages
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.message_types import CAMERA_INFO, PERSON_POSES, decode
from stcalib_ros.io.messages import camera_info_fields, pose_image
from stcalib_ros.ros.solver import SolverError, calibrate_in_subprocess

NAMES = ("cam0", "cam1")


@pytest.fixture(scope="module")
def cameras(tmp_path_factory: pytest.TempPathFactory) -> list[CameraImages]:
    path: Path = tmp_path_factory.mktemp("bag") / "walk.mcap"
    options = SceneOptions(n_cameras=2, n_people=1, n_frames=150, seed=3)
    write_bag(simulate(options).recording, path)
    return [of_camera(path, name) for name in NAMES]


def of_camera(bag: Path, name: str) -> CameraImages:
    poses, info = f"/{name}/person_poses", f"/{name}/camera_info"
    of_poses = [m.data for m in raw_messages([bag], frozenset({poses}))]
    lens = next(m.data for m in raw_messages([bag], frozenset({info})))
    return CameraImages(
        name=name,
        images=[pose_image(decode(PERSON_POSES.name, data), topic=poses) for data in of_poses],
        info=camera_info_fields(decode(CAMERA_INFO.name, lens)),
        pose_topic=poses,
        info_topic=info,
    )


def never() -> bool:
    return False


def quiet(*_: object) -> None:
    pass


def test_it_gives_the_numbers_of_this_process(cameras):
    steps, warnings = [], []
    found = calibrate_in_subprocess(
        list(cameras),
        Options(),
        cancelled=never,
        warn=warnings.append,
        progress=lambda stage, fraction: steps.append((stage, fraction)),
    )
    here_steps: list[tuple[str, float]] = []
    here = calibrate(
        assemble_recording(cameras, warn=print),
        Options(),
        progress=lambda stage, fraction: here_steps.append((stage, fraction)),
    )
    assert (found.status, found.message) == (here.status, here.message)
    assert [camera.name for camera in found.cameras] == list(NAMES)
    for a, b in zip(found.cameras, here.cameras, strict=True):
        np.testing.assert_array_equal(a.t_ref_cam, b.t_ref_cam)
        assert a.time_offset_s == b.time_offset_s
    assert steps == here_steps
    assert warnings == []
    assert multiprocessing.active_children() == []


def test_it_is_killed_when_cancelled(cameras):
    stages: list[str] = []
    with pytest.raises(Cancelled, match="cancelled during"):
        calibrate_in_subprocess(
            list(cameras),
            Options(),
            cancelled=lambda: bool(stages),
            warn=quiet,
            progress=lambda stage, _fraction: stages.append(stage),
        )
    assert multiprocessing.active_children() == []


def test_it_can_be_cancelled_before_anything_is_done(cameras):
    with pytest.raises(Cancelled, match="assembly"):
        calibrate_in_subprocess(list(cameras), Options(), cancelled=lambda: True, warn=quiet)


def test_what_the_data_lacks_is_told(cameras):
    first = cameras[0]
    turned = [replace(image, metric=False) for image in first.images[:10]]
    mixed = replace(first, images=[*turned, *first.images[10:]])
    with pytest.raises(InputError, match="metric changes from False"):
        calibrate_in_subprocess([mixed, cameras[1]], Options(), cancelled=never, warn=quiet)


def test_what_nobody_foresaw_is_told(cameras):
    with pytest.raises(SolverError, match="AttributeError: "):
        calibrate_in_subprocess(list(cameras), "none", cancelled=never, warn=quiet)  # type: ignore[arg-type]


def test_a_process_that_is_killed_is_told(cameras):
    def kill(_stage: str, _fraction: float) -> None:
        for child in multiprocessing.active_children():
            os.kill(int(child.pid or 0), signal.SIGKILL)

    with pytest.raises(SolverError, match=r"exit code -9.*window_s"):
        calibrate_in_subprocess(
            list(cameras), Options(), cancelled=never, warn=quiet, progress=kill
        )


def test_memory_has_a_limit(cameras):
    """The process raises MemoryError, or OpenBLAS ends it."""
    with pytest.raises(SolverError, match=r" 4 MB beside the images.* make window_s smaller"):
        calibrate_in_subprocess(
            list(cameras), Options(), cancelled=never, warn=quiet, progress=quiet, memory_mb=4.0
        )
    assert multiprocessing.active_children() == []


def test_images_are_not_kept_once_they_are_handed_over(cameras):
    given, left = list(cameras), []
    with pytest.raises(Cancelled):
        calibrate_in_subprocess(
            given,
            Options(),
            cancelled=lambda: bool(left),
            warn=quiet,
            progress=lambda *_: left.append(len(given)),
        )
    assert left[0] == 0


def test_interrupts_are_heard_as_before(cameras):
    with pytest.raises(Cancelled):
        calibrate_in_subprocess(list(cameras), Options(), cancelled=lambda: True, warn=quiet)
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
