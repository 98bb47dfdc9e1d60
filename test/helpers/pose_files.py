"""A small scene as pose estimators would write it down, and its comparison with what was read."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import NamedTuple

import numpy as np

import stcalib_ros as st
from stcalib_ros.cli import main
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.camera_info_yaml import camera_info_text

FPS = 30.0
N_FRAMES = 120


class Seen(NamedTuple):
    """One person in one image: `points` are (J, 3), x, y and score; 0, 0, 0 where not found."""

    track: int
    points: np.ndarray


OPTIONS = st.SceneOptions(
    n_cameras=3, n_people=3, n_frames=N_FRAMES, fps=FPS, drop_rate=0.0, seed=3
)


@functools.cache
def scene() -> Recording:
    """Three cameras at 30 Hz, three people, for four seconds; images of 1920 x 1080 px."""
    return st.keypoints_only(st.simulate(OPTIONS).recording)


def write_lenses(folder: Path) -> Path:
    """Write the lenses of the scene, as ``camera_info_manager`` has them."""
    folder.mkdir()
    for camera in st.simulate(OPTIONS).truth.cameras:
        (folder / f"{camera.name}.yaml").write_text(camera_info_text(camera))
    return folder


def seen_by(camera: CameraRecording, layout: str, n_images: int = N_FRAMES) -> list[list[Seen]]:
    """People of each image in the joints of a layout; the head of the scene is the nose."""
    names = ["head" if n == "nose" else n for n in LAYOUTS[layout].joint_names]
    own = camera.layout.joint_names
    joints = [own.index(n) if n in own else -1 for n in names]
    known = np.array(joints) >= 0
    images: list[list[Seen]] = [[] for _ in range(n_images)]
    for track in camera.tracks:
        for row, frame in enumerate(track.frames[track.frames < n_images]):
            xy, score = track.keypoints[row][joints], track.scores[row][joints]
            there = known & np.isfinite(xy).all(-1)
            points = np.where(there[:, None], np.c_[xy, score], 0.0)
            if there.any():
                images[int(frame)].append(Seen(track.track_id, np.round(points, 3)))
    return images


def convert(source: Path, *arguments: str) -> Recording:
    """Convert a source by the command, and read the bag that it wrote."""
    bag = source.parent / "out.mcap"
    assert main(["convert", str(source), str(bag), *arguments]) == 0
    return read_bag(bag)


def assert_read(
    camera: CameraRecording, images: list[list[Seen]], *, tracked: bool, atol_px: float = 2e-3
) -> None:
    """Compare a camera of a bag with what was written to a source."""
    assert len(camera.stamps) == len(images)
    read: list[dict[int, np.ndarray]] = [{} for _ in images]
    for track in camera.tracks:
        for row, frame in enumerate(track.frames):
            points = np.c_[track.keypoints[row], track.scores[row]]
            read[int(frame)][track.track_id] = np.where(np.isfinite(points), points, 0.0)
    for found, expected in zip(read, images, strict=True):
        if tracked:
            assert set(found) == {one.track for one in expected}
        for points, one in zip(found.values(), _ordered(expected, found, tracked), strict=True):
            np.testing.assert_allclose(points[:, :2], one.points[:, :2], atol=atol_px)
    if not tracked:
        assert all(len(track.frames) == 1 for track in camera.tracks), "an id for each pose"


def _ordered(expected: list[Seen], found: dict[int, np.ndarray], tracked: bool) -> list[Seen]:
    by_id = {one.track: one for one in expected}
    return [by_id[i] for i in found] if tracked else expected
