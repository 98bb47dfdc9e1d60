"""Pictures and films that are written."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2

from stcalib_ros.core.errors import InputError
from stcalib_ros.estimation.poses import UInt8Array
from stcalib_ros.io.files import atomic_path, require_writable

_PICTURES = (".png", ".jpg")
_FILM = ".mp4"


def require_picture_writable(path: Path) -> bool:
    """Make sure, before the work, that a picture or film can be written; true of a film.

    Raises
    ------
    InputError
        Its folder cannot be written to, or its name ends as none of them.
    """
    if path.suffix not in (*_PICTURES, _FILM):
        raise InputError(f"cannot draw {path}: its name must end in .png, .jpg or .mp4")
    require_writable(path)
    return path.suffix == _FILM


def write_picture(path: Path, images: Iterable[UInt8Array], *, rate_hz: float) -> int:
    """Write the first image as a picture, or all of them as a film, and return how many.

    Parameters
    ----------
    path : Path
        Its name says which.
    images : iterable of (height, width, 3) ndarray
        Of one size, the sides even; blue, green, red.
    rate_hz : float
        Images per second of a film.

    Raises
    ------
    InputError
        There is no image, or it cannot be written.
    """
    source = iter(images)
    first = next(source, None)
    if first is None:
        raise InputError("the films have no images at that time: choose another with --at")
    with atomic_path(path) as temporary:
        if path.suffix in _PICTURES:
            temporary.write_bytes(cv2.imencode(path.suffix, first)[1].tobytes())
            return 1
        # OpenCV chooses the container by the name.
        named = temporary.with_name(f"{temporary.stem}{_FILM}")
        try:
            n = _write_film(named, first, source, rate_hz)
            named.replace(temporary)
        finally:
            named.unlink(missing_ok=True)
        return n


def _write_film(path: Path, first: UInt8Array, others: Iterable[UInt8Array], rate_hz: float) -> int:
    height, width = first.shape[:2]
    code = cv2.VideoWriter.fourcc(*"vp09")  # which browsers play, and OpenCV's wheels can write
    writer = cv2.VideoWriter(str(path.absolute()), cv2.CAP_FFMPEG, code, rate_hz, (width, height))
    if not writer.isOpened():
        raise InputError(f"cannot write the film {path}: this OpenCV has no encoder; draw a .png")
    n = 1
    try:
        writer.write(first)
        for image in others:
            writer.write(image)
            n += 1
    finally:
        writer.release()
    return n
