"""Films that tests make, and an estimator that knows what is in them."""

from __future__ import annotations

import os
import struct
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

import stcalib_ros as st
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS, Layout
from stcalib_ros.estimation.poses import ImagePoses, UInt8Array

SIDE = 16
"""Pixels. Side of the squares at the top of an image that are the binary digits of a number."""
DIGITS = 14
_PARENTS = (b"moov", b"trak", b"mdia", b"minf", b"stbl")


def numbered_image(number: int, size: tuple[int, int]) -> UInt8Array:
    """An image, blue, whose first row of squares shows a number."""
    image = np.zeros((size[1], size[0], 3), np.uint8)
    image[..., 0] = 80
    for digit in range(DIGITS):
        image[:SIDE, digit * SIDE : (digit + 1) * SIDE] = 255 * (number >> digit & 1)
    return image


def number_of(image: UInt8Array) -> int:
    """Return the number that an image shows."""
    middles = image[SIDE // 2, SIDE // 2 : DIGITS * SIDE : SIDE].mean(-1)
    return sum(1 << digit for digit, grey in enumerate(middles) if grey > 127)


def write_film(
    path: Path, numbers: Sequence[int], *, fps: float = 10.0, size: tuple[int, int] = (320, 240)
) -> Path:
    """Write a film of numbered images."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # OpenCV reads it once
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), fps, size)
    assert writer.isOpened()
    for number in numbers:
        writer.write(numbered_image(number, size))
    writer.release()
    return path


def with_stamps(path: Path, stamps_s: Sequence[float]) -> Path:
    """Give the images of an MP4 file, whose table of contents is at its end, other times.

    The last one must not be later than it was.
    """
    content = path.read_bytes()
    at = content.index(b"mdhd") + 4
    ticks_hz = struct.unpack(">I", content[at + 12 : at + 16])[0]
    ticks = np.diff(np.round(np.array([*stamps_s, 2 * stamps_s[-1] - stamps_s[-2]]) * ticks_hz))
    table = b"".join(struct.pack(">II", 1, int(tick)) for tick in ticks)
    box = struct.pack(">I4sII", 16 + len(table), b"stts", 0, len(ticks)) + table
    at = content.index(b"stts") - 4
    old = struct.unpack(">I", content[at : at + 4])[0]
    content = content[:at] + box + content[at + old :]
    for name in _PARENTS:
        start = content.index(name) - 4
        length = struct.unpack(">I", content[start : start + 4])[0] + len(box) - old
        content = content[:start] + struct.pack(">I", length) + content[start + 4 :]
    path.write_bytes(content)
    return path


def made_at(path: Path, unix_s: int, *, android: bool = False) -> Path:
    """Write into an MP4 file when it was made."""
    content = bytearray(path.read_bytes())
    at = content.index(b"mvhd") + 8
    content[at : at + 4] = struct.pack(">I", unix_s + 2_082_844_800)
    if android:
        at = content.index(b"Lavf")
        content[at : at + 19] = b"com.android.version"
    path.write_bytes(content)
    return path


def turned(path: Path) -> Path:
    """Write into an MP4 file that it is to be shown turned by 90 degrees, clockwise."""
    content = bytearray(path.read_bytes())
    at = content.index(b"tkhd") + 4 + 40
    one = 1 << 16
    content[at : at + 36] = struct.pack(">9i", 0, one, 0, -one, 0, 0, 0, 0, 1 << 30)
    path.write_bytes(content)
    return path


class NumberEstimator:
    """Returns the persons that a recording has in the image whose number an image shows.

    Parameters
    ----------
    poses : Path
        Of `write_scene_films`.
    """

    layout: Layout

    def __init__(self, poses: Path) -> None:
        with np.load(poses) as arrays:
            self._keypoints, self._scores = arrays["keypoints"], arrays["scores"]
            self.layout = LAYOUTS[str(arrays["layout"])]

    def poses(self, image: UInt8Array) -> ImagePoses:
        keypoints = self._keypoints[number_of(image)]
        there = np.isfinite(keypoints).any((1, 2))
        joints = np.full((*keypoints[there].shape[:2], 3), np.nan)
        return ImagePoses(keypoints[there], self._scores[number_of(image)][there], joints)


class SlowEstimator(NumberEstimator):
    """Takes its time, for an interruption to come amid the work."""

    def poses(self, image: UInt8Array) -> ImagePoses:
        time.sleep(0.03)
        return super().poses(image)


def write_scene_films(
    folder: Path, options: st.SceneOptions
) -> tuple[dict[str, Path], st.Recording]:
    """Write a film of each camera of a simulated scene, and ``poses.npz`` for `NumberEstimator`.

    Returns
    -------
    films : dict of str to Path
    recording : Recording
        What they show, with the stamps of the films.
    """
    recording = st.simulate(options).recording
    n_people = max(len(camera.tracks) for camera in recording.cameras)
    n_images = sum(len(camera.stamps) for camera in recording.cameras)
    layout = recording.cameras[0].layout
    keypoints = np.full((n_images, n_people, layout.n_joints, 2), np.nan)
    scores = np.zeros(keypoints.shape[:3])
    films, first, cameras = {}, 0, []
    for camera in recording.cameras:
        for k, track in enumerate(camera.tracks):
            keypoints[first + track.frames, k] = track.keypoints
            scores[first + track.frames, k] = track.scores
        size = (camera.intrinsics.width, camera.intrinsics.height)
        numbers = range(first, first + len(camera.stamps))
        film = write_film(folder / f"{camera.name}.mp4", numbers, fps=options.fps, size=size)
        stamps = camera.stamps - camera.stamps[0]
        films[camera.name] = with_stamps(film, stamps)
        cameras.append(replace(camera, stamps=stamps))
        first += len(camera.stamps)
    poses = {"keypoints": keypoints, "scores": scores, "layout": layout.name}
    np.savez_compressed(folder / "poses.npz", **poses)
    return films, replace(recording, cameras=tuple(cameras))
