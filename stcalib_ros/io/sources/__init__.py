"""What pose estimators and motion capture programs write: 2D poses of each camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.sources.caliscope import CALISCOPE
from stcalib_ros.io.sources.cameras import files_below, natural_order
from stcalib_ros.io.sources.coco import ALPHAPOSE, COCO
from stcalib_ros.io.sources.easymocap import EASYMOCAP_2D
from stcalib_ros.io.sources.form import (
    CameraPoses,
    PoseFormat,
    PoseSource,
    SourceOptions,
    reading,
)
from stcalib_ros.io.sources.freemocap import FREEMOCAP
from stcalib_ros.io.sources.landmarks import MEDIAPIPE
from stcalib_ros.io.sources.mmpose import MMPOSE
from stcalib_ros.io.sources.openpose import OPENPOSE
from stcalib_ros.io.sources.pose2sim import POSE2SIM
from stcalib_ros.io.sources.ultralytics import ULTRALYTICS

__all__ = ["SOURCES", "PoseSource", "SourceOptions", "part_of_source", "read_source"]

SOURCES: Mapping[str, PoseFormat] = {
    "pose2sim": POSE2SIM,
    "caliscope": CALISCOPE,
    "freemocap": FREEMOCAP,
    "easymocap_2d": EASYMOCAP_2D,
    "alphapose": ALPHAPOSE,
    "openpose": OPENPOSE,
    "mmpose": MMPOSE,
    "coco": COCO,
    "ultralytics": ULTRALYTICS,
    "mediapipe": MEDIAPIPE,
}
"""Formats by their names, in the order in which they are tried: special ones first."""


def read_source(name: str, path: Path) -> PoseSource:
    """Read the poses of all cameras; cameras are in the order of their names, cam2 before cam10.

    Parameters
    ----------
    name : str
        One of `SOURCES`.
    path : Path

    Raises
    ------
    InputError
        Files are missing or have another form, or there is no pose in them.
    """
    files = files_below(path)
    with reading(path, SOURCES[name].what):
        source = SOURCES[name].read(path, files)
    if not source.cameras:
        raise InputError(f"{path} has no files of poses that can be read ({SOURCES[name].what})")
    if not any(camera.poses for camera in source.cameras):
        n = sum(len(camera.images) for camera in source.cameras)
        raise InputError(
            f"{path} has nobody in any of {n} images ({SOURCES[name].what}): check that the pose "
            "estimator saw the people"
        )
    cameras = sorted(source.cameras, key=lambda camera: natural_order(camera.name))
    return replace(source, cameras=tuple(cameras))


def part_of_source(
    source: PoseSource, names: Sequence[str] | None, frames: tuple[int, int] | None
) -> PoseSource:
    """Return some of the cameras, in that order, and some of their images, by their numbers.

    Raises
    ------
    InputError
        There is no such camera, or a camera has no such image.
    """
    by_name = {camera.name: camera for camera in source.cameras}
    if missing := [name for name in names or () if name not in by_name]:
        raise InputError(
            f"{source.path} has no camera {', '.join(missing)}: there are {', '.join(by_name)}"
        )
    cameras = [by_name[name] for name in names or by_name]
    if frames is not None:
        cameras = [_images(source.path, camera, *frames) for camera in cameras]
    return replace(source, cameras=tuple(cameras))


def _images(path: Path, camera: CameraPoses, first: int, last: int) -> CameraPoses:
    chosen = (camera.images >= first) & (camera.images <= last)
    if not chosen.any():
        raise InputError(
            f"{path}: {camera.name} has images {camera.images[0]} to {camera.images[-1]}, none of "
            f"{first} to {last}"
        )
    return replace(
        camera,
        images=camera.images[chosen],
        poses=tuple(pose for pose in camera.poses if first <= pose.image <= last),
        stamps_ns=None if camera.stamps_ns is None else np.asarray(camera.stamps_ns)[chosen],
    )
