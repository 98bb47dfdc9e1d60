"""Films: images with the times that their container gives them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.estimation.poses import UInt8Array
from stcalib_ros.io.film_header import FilmHeader, read_film_header
from stcalib_ros.io.limits import MAX_FRAME_RATE, MIN_FRAME_RATE
from stcalib_ros.io.plausible import require_size

_ROUNDING = 0.02
"""Fraction of a period. An image that is earlier than its turn by less is taken: containers round
times to milliseconds, 1 % of a period at 10 Hz. Chosen, twice that."""
_SAME_IMAGE = 0.25
"""Fraction of a period. An image that is earlier than a time by less is the one of that time: bags
and films round differently. Chosen, below half, where it would be the image before."""
_MS = 1e-3
"""Seconds in a millisecond, the unit of OpenCV's times."""
_NOT_A_FILM = "is no film that can be read"


@dataclass(frozen=True, slots=True)
class Film:
    """A film of one camera.

    Attributes
    ----------
    camera : str
    path : Path
    size : (int, int)
        Width and height of its images as they are shown: turned by the rotation tag, px.
    rate_hz : float
        Images per second by its header: an average where the rate varies.
    n_images : int
        How many images there are by its header, about.
    header : FilmHeader
    """

    camera: str
    path: Path
    size: tuple[int, int]
    rate_hz: float
    n_images: int
    header: FilmHeader


class FilmImage(NamedTuple):
    """An image, and its time after the first image of its film, seconds."""

    stamp_s: float
    image: UInt8Array


def open_film(camera: str, path: Path) -> Film:
    """Look at a film: that it can be decoded, its size and its rate.

    Parameters
    ----------
    camera : str
        Its name.
    path : Path

    Raises
    ------
    InputError
        It is not there, is no film, or its images cannot be decoded.
    """
    header = _readable(path)
    with _decoder(path) as decoder:
        if not decoder.grab():
            raise InputError(_why_unreadable(path, header))
        first = decoder.retrieve()[1]
        if first is None:
            raise InputError(f"{path}: its first image cannot be decoded: the file is damaged")
        if not decoder.grab():
            raise InputError(f"{path} has one image: give a film of people walking, not a picture")
        rate_hz, count = decoder.get(cv2.CAP_PROP_FPS), decoder.get(cv2.CAP_PROP_FRAME_COUNT)
    height, width = first.shape[:2]
    size = require_size((width, height), f"{path}: images")
    rate_hz = rate_hz if MIN_FRAME_RATE <= rate_hz <= MAX_FRAME_RATE else MAX_FRAME_RATE
    return Film(camera, path, size, rate_hz, max(round(count), 2), header)


def expected_images(film: Film, limit_hz: float) -> int:
    """Return about how many images `film_images` yields: an estimate by the header."""
    return max(round(film.n_images * min(1.0, limit_hz / film.rate_hz)), 1)


def film_images(film: Film, *, limit_hz: float, skip: int = 0) -> Iterator[FilmImage]:
    """Yield images of a film with their times, at most `limit_hz` a second.

    Images are chosen by their times, the first of each period; others are neither converted to
    colours nor copied. An image that is not later than the one before has no time and is left out.

    Parameters
    ----------
    film : Film
    limit_hz : float
        Images a second; positive.
    skip : int
        How many of the chosen images to leave out at the begin.

    Raises
    ------
    InputError
        The film cannot be read any more, or its images change their size.
    """
    turn, last_s = -1, -1.0
    with _decoder(film.path) as decoder:
        while decoder.grab():
            stamp_s = decoder.get(cv2.CAP_PROP_POS_MSEC) * _MS
            period = int(stamp_s * limit_hz + _ROUNDING)
            if stamp_s <= last_s or period <= turn:
                continue
            turn, last_s = period, stamp_s
            if skip > 0:
                skip -= 1
                continue
            image = decoder.retrieve()[1]
            if image is None:
                continue
            if image.shape[1::-1] != film.size:
                raise InputError(
                    f"{film.path}: images change from {film.size[0]} x {film.size[1]} to "
                    f"{image.shape[1]} x {image.shape[0]} px at {stamp_s:.2f} s: cut the film there"
                )
            yield FilmImage(stamp_s, image.astype(np.uint8, copy=False))


def frame_times_s(film: Film) -> Float64Array:
    """Return the times (N,) of all images of a film after its first one, seconds."""
    times_s = []
    with _decoder(film.path) as decoder:
        while decoder.grab():
            times_s.append(decoder.get(cv2.CAP_PROP_POS_MSEC) * _MS)
    return np.array(times_s) - times_s[0]


def images_at(film: Film, stamps_s: Sequence[float]) -> Iterator[UInt8Array]:
    """Yield the images of a film at some times; fewer, if it ends before.

    Parameters
    ----------
    film : Film
    stamps_s : sequence of float
        Increasing times after its first image, seconds, as `film_images` gives them.
    """
    early_s = _SAME_IMAGE / film.rate_hz
    waiting = iter(stamps_s)
    wanted_s = next(waiting, None)
    with _decoder(film.path) as decoder:
        while wanted_s is not None and decoder.grab():
            if decoder.get(cv2.CAP_PROP_POS_MSEC) * _MS < wanted_s - early_s:
                continue
            image = decoder.retrieve()[1]
            while image is not None and wanted_s is not None:
                yield image.astype(np.uint8, copy=False)
                after_s, wanted_s = wanted_s, next(waiting, None)
                if wanted_s != after_s:
                    break


@contextmanager
def _decoder(path: Path) -> Iterator[cv2.VideoCapture]:
    """OpenCV's decoder by FFmpeg; what that prints about damaged bytes is not shown."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # AV_LOG_QUIET
    log = getattr(cv2.utils, "logging", None)  # OpenCV 4.6 has none
    level = log.getLogLevel() if log else 0
    if log:
        log.setLogLevel(log.LOG_LEVEL_SILENT)
    try:
        decoder = cv2.VideoCapture(str(path.absolute()), cv2.CAP_FFMPEG)
    finally:
        if log:
            log.setLogLevel(level)
    try:
        yield decoder
    finally:
        decoder.release()


def _readable(path: Path) -> FilmHeader:
    if not path.is_file():
        what = "a folder" if path.is_dir() else "no such file"
        raise InputError(f"cannot read the film {path}: {what}")
    try:
        if not path.stat().st_size:
            raise InputError(f"{path} is empty: copy the film again")
        return read_film_header(path)
    except OSError as error:
        raise InputError(f"cannot read the film {path}: {error.strerror}") from error


def _why_unreadable(path: Path, header: FilmHeader) -> str:
    if header.missing_bytes:
        return (
            f"{path} {_NOT_A_FILM}: {header.missing_bytes} bytes are missing at its end; it is cut "
            "off or still being written: copy it again when it is finished"
        )
    if header.made_s is None and path.suffix.lower() in (".mp4", ".mov", ".m4v"):
        return (
            f"{path} {_NOT_A_FILM}: it has no images or no table of contents; a film that is still "
            "being written, or whose camera was switched off, has none: stop the recording first"
        )
    return f"{path} {_NOT_A_FILM}: give videos, such as MP4 of H.264"
