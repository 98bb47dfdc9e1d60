"""Images to films by the program ffmpeg: H.264, with the stamps of the camera in the container."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

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
        Images are missing, there is no ffmpeg, or it failed.
    """
    paths = sorted(folder.glob("??????.png"))[: len(ticks)]
    if len(paths) < len(ticks):
        raise InputError(f"{folder}: {len(paths)} images of {len(ticks)}; take the others first")
    partial = output.with_name(f"{output.stem}.part.mp4")
    with tempfile.NamedTemporaryFile("w", suffix=".ffconcat") as plan:
        plan.write("".join(_plan(paths, ticks, rate_hz)))
        plan.flush()
        try:
            done = subprocess.run(
                _command(plan.name, partial, quality), capture_output=True, text=True, check=False
            )
        except FileNotFoundError as error:
            raise InputError("no program ffmpeg: apt-get install ffmpeg") from error
    if done.returncode:
        raise InputError(f"ffmpeg failed on {folder}: {done.stderr.strip().splitlines()[-1:]}")
    partial.replace(output)


def _plan(paths: Sequence[Path], ticks: IntArray, rate_hz: float) -> Iterator[str]:
    """Yield what ffmpeg is to show, and for how long; its times are multiples of a tick."""
    yield "ffconcat version 1.0\n"
    for path, begin, end in zip(paths, ticks, [*ticks[1:], ticks[-1] + 1], strict=True):
        yield f"file '{path.absolute()}'\noption framerate {rate_hz:g}\n"
        yield f"duration {(end - begin) / rate_hz:.9f}\n"


def _command(plan: str, output: Path, quality: int) -> list[str]:
    """Return the call of ffmpeg.

    Without B frames: some readers lose the stamps of the last images of films that have them.
    """
    return [
        *("ffmpeg", "-v", "error", "-y", "-f", "concat", "-safe", "0", "-i", plan),
        *("-vsync", "passthrough", "-c:v", "libx264", "-preset", "slow", "-crf", str(quality)),
        *("-bf", "0", "-threads", "1", "-pix_fmt", "yuv420p"),
        *("-video_track_timescale", "90000", str(output)),
    ]
