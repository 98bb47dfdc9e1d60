"""What the videos say, in which a pose estimator found people: frame rate and size of images."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import cv2

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.sources.cameras import plain_name
from stcalib_ros.io.sources.form import CameraPoses

VIDEO_ENDINGS = (".mp4", ".avi", ".mov", ".mkv", ".m4v", ".webm")
"""Endings of the names of videos, in small letters."""


def with_videos(cameras: Iterable[CameraPoses], folder: Path) -> tuple[CameraPoses, ...]:
    """Cameras with the frame rate and size of the videos that are named like them.

    Those of the source take precedence. Cameras without a video stay as they are.

    Raises
    ------
    InputError
        A video cannot be read.
    """
    files = sorted(folder.iterdir()) if folder.is_dir() else []
    videos = {plain_name(f.stem): f for f in files if f.suffix.lower() in VIDEO_ENDINGS}
    return tuple(
        _with_video(camera, videos[camera.name]) if camera.name in videos else camera
        for camera in cameras
    )


def _with_video(camera: CameraPoses, path: Path) -> CameraPoses:
    video = cv2.VideoCapture(str(path))
    try:
        keys = (cv2.CAP_PROP_FPS, cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        fps, width, height = (video.get(key) for key in keys)
    finally:
        video.release()
    if not (fps > 0 and width > 0 and height > 0):
        raise InputError(f"cannot read the video {path}: give --fps and --image-size without it")
    return replace(camera, fps=camera.fps or fps, size=camera.size or (round(width), round(height)))
