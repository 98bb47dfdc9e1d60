"""Images to films by the program ffmpeg: H.264, with the stamps of the camera in the container."""

from __future__ import annotations

import subprocess
from pathlib import Path

import cv2
import numpy as np

from benchmarks.film.cameras import HEIGHT, WIDTH
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import IntArray


def encode(folder: Path, ticks: IntArray, rate_hz: float, output: Path, quality: int) -> None:
    """Write the first images of a folder, in order of their names, as one film.

    Parameters
    ----------
    folder : Path
    ticks : (N,) ndarray of int
        Tick of the clock of `rate_hz` of each image. Ticks without an image have none in the film.
    rate_hz : float
    output : Path
    quality : int
        Constant rate factor of x264: larger is smaller and worse.

    Raises
    ------
    InputError
        There is no ffmpeg, or it failed.
    """
    paths = sorted(folder.glob("??????.png"))
    if len(paths) < len(ticks):
        raise InputError(f"{folder}: {len(paths)} images of {len(ticks)}; take the others first")
    partial = output.with_name(f"{output.stem}.part.mp4")
    try:
        with subprocess.Popen(_command(ticks, rate_hz, partial, quality), stdin=-1) as process:
            assert process.stdin is not None
            at = np.searchsorted(ticks, np.arange(ticks[-1] + 1), side="right") - 1
            for k in at:
                process.stdin.write(np.asarray(cv2.imread(str(paths[k]))).tobytes())
            process.stdin.close()
    except FileNotFoundError as error:
        raise InputError("no program ffmpeg: apt-get install ffmpeg") from error
    if process.returncode:
        raise InputError(f"ffmpeg failed with exit status {process.returncode} on {folder}")
    partial.replace(output)


def _command(ticks: IntArray, rate_hz: float, output: Path, quality: int) -> list[str]:
    """Return the call of ffmpeg, which is given an image for every tick and leaves some out.

    Without B frames: some readers lose the stamps of the last images of films that have them.
    """
    every = len(ticks) == ticks[-1] + 1
    chosen = [] if every else ["-vf", "select='" + "+".join(f"eq(n,{t})" for t in ticks) + "'"]
    size = ["-video_size", f"{WIDTH}x{HEIGHT}", "-framerate", str(rate_hz)]
    x264 = ["-c:v", "libx264", "-preset", "slow", "-crf", str(quality), "-bf", "0", "-threads", "1"]
    return [
        *("ffmpeg", "-v", "error", "-y", "-f", "rawvideo", "-pixel_format", "bgr24"),
        *(*size, "-i", "-", *chosen, "-vsync", "passthrough"),
        *(*x264, "-pix_fmt", "yuv420p", "-video_track_timescale", "90000", str(output)),
    ]
