"""People of a calibration, drawn into the images of all cameras at one time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import cv2
import numpy as np

from stcalib_ros.core.capture.reprojection import ImageOfPeople
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.estimation.poses import UInt8Array
from stcalib_ros.report.style import BACKGROUND, FIGURES

WIDTH_PX = 1920
"""Pixels. Width of the whole picture, of which all cameras have a part: a usual screen's."""
_MAX_HEIGHT_PX = 1080
"""Pixels. Height of the whole picture, likewise; films of phones that stand are high."""
_GAP_PX = 6
"""Pixels between the images of two cameras."""
_STRIP_PX = 34
"""Pixels. Height of the line of text over an image."""
_WHITE = (255, 255, 255)
_DARK = (20, 20, 20)
_FONT = cv2.FONT_HERSHEY_DUPLEX
_FONT_SCALE = 0.62
"""Factor of OpenCV's font: capital letters of about 13 px."""
_OVER_HEAD_PX = 16
"""Pixels between the highest joint of a person and their name."""


def mosaic(
    images: Sequence[tuple[ImageOfPeople, UInt8Array]],
    bones: Iterable[tuple[int, int]],
    begin_s: float,
    cameras: Sequence[str],
) -> UInt8Array:
    """Return a picture of the images of all cameras with the people in them.

    Parameters
    ----------
    images : sequence of (ImageOfPeople, (height, width, 3) ndarray)
        Of some cameras at one time; blue, green, red.
    bones : iterable of (int, int)
        Numbers of the joints that a line connects.
    begin_s : float
        Time from which the time that is shown counts, as `ImageOfPeople.time_s`.
    cameras : sequence of str
        All of them, each of which has its place.
    """
    lines = list(bones)
    shapes = [image.shape for _, image in images]
    columns, size = _grid(len(cameras), max(w / h for h, w, *_ in shapes))
    by_name = {one.camera.name: (one, image) for one, image in images}
    tiles = [
        _tile(*by_name[name], size, lines, begin_s) if name in by_name else _empty(name, size)
        for name in cameras
    ]
    blank = np.full_like(tiles[0], BACKGROUND)
    tiles += [blank] * (-len(tiles) % columns)
    gap = np.full((tiles[0].shape[0], _GAP_PX, 3), BACKGROUND, np.uint8)
    rows = []
    for first in range(0, len(tiles), columns):
        parts = [part for tile in tiles[first : first + columns] for part in (tile, gap)][:-1]
        rows.append(np.concatenate(parts, axis=1))
    between = np.full((_GAP_PX, rows[0].shape[1], 3), BACKGROUND, np.uint8)
    picture = np.concatenate([part for row in rows for part in (row, between)][:-1])
    height, width = (side - side % 2 for side in picture.shape[:2])  # films have even sides
    return np.ascontiguousarray(picture[:height, :width])


def _grid(n: int, aspect: float) -> tuple[int, tuple[int, int]]:
    """Return the number of columns, and width and height of an image, largest where all fit."""
    best = (0.0, 1, (1, 1))
    for columns in range(1, n + 1):
        rows = math.ceil(n / columns)
        width = (WIDTH_PX - (columns - 1) * _GAP_PX) / columns
        height = (_MAX_HEIGHT_PX - (rows - 1) * _GAP_PX) / rows - _STRIP_PX
        scale = min(width, height * aspect)
        if scale > best[0]:
            best = (scale, columns, (int(scale), int(scale / aspect)))
    return best[1], best[2]


def _tile(
    one: ImageOfPeople,
    image: UInt8Array,
    size: tuple[int, int],
    bones: Sequence[tuple[int, int]],
    begin_s: float,
) -> UInt8Array:
    """Return an image with its people and a line of text over it."""
    height, width = image.shape[:2]
    factor = min(size[0] / width, size[1] / height)
    small = (max(round(width * factor), 1), max(round(height * factor), 1))
    shrinks = cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR
    part = cv2.resize(image, small, interpolation=shrinks).astype(np.uint8)
    # Centres of pixels are at whole numbers, before and after.
    scaled = {k: (p + 0.5) * factor - 0.5 for k, p in one.projected.items()}
    _draw_people(part, scaled, bones)
    _draw_found(part, (one.found + 0.5) * factor - 0.5)
    _draw_names(part, scaled)
    tile = _empty(one.camera.name, size)
    left, top = (size[0] - small[0]) // 2, _STRIP_PX + (size[1] - small[1]) // 2
    tile[top : top + small[1], left : left + small[0]] = part
    fits = f"{one.residual_px:.1f} px" if one.n_compared else "nobody"
    _text(tile, f"{one.time_s - begin_s:.2f} s   {fits}", (size[0] - 8, 24), right=True)
    return tile


def _empty(name: str, size: tuple[int, int]) -> UInt8Array:
    tile = np.full((size[1] + _STRIP_PX, size[0], 3), BACKGROUND, np.uint8)
    _text(tile, name, (8, 24))
    return tile


def _draw_people(
    image: UInt8Array, people: Mapping[int, Float64Array], bones: Sequence[tuple[int, int]]
) -> None:
    for person, joints in people.items():
        colour = _colour(person)
        known = np.asarray(np.isfinite(joints).all(-1))
        lines = [(a, b) for a, b in bones if known[a] and known[b]]
        for thickness, shade in ((6, _DARK), (3, colour)):
            for a, b in lines:
                cv2.line(image, _at(joints[a]), _at(joints[b]), shade, thickness, cv2.LINE_AA)
        for joint in joints[known]:
            cv2.circle(image, _at(joint), 5, _DARK, -1, cv2.LINE_AA)
            cv2.circle(image, _at(joint), 4, colour, -1, cv2.LINE_AA)


def _draw_found(image: UInt8Array, found: Float64Array) -> None:
    for point in found.reshape(-1, 2)[np.isfinite(found).all(-1).ravel()]:
        cv2.circle(image, _at(point), 2, _WHITE, -1, cv2.LINE_AA)


def _draw_names(image: UInt8Array, people: Mapping[int, Float64Array]) -> None:
    for person, joints in people.items():
        x = int(np.nanmedian(joints[:, 0]))
        y = int(np.nanmin(joints[:, 1])) - _OVER_HEAD_PX
        text = f"P{person}"
        (width, height), _ = cv2.getTextSize(text, _FONT, _FONT_SCALE, 1)
        x = int(np.clip(x - width // 2, 4, max(image.shape[1] - width - 4, 4)))
        y = int(np.clip(y, height + 6, max(image.shape[0] - 6, height + 6)))
        corners = (x - 5, y - height - 5), (x + width + 5, y + 5)
        cv2.rectangle(image, *corners, _colour(person), -1, cv2.LINE_AA)
        cv2.putText(image, text, (x, y), _FONT, _FONT_SCALE, _DARK, 1, cv2.LINE_AA)


def _text(image: UInt8Array, text: str, at: tuple[int, int], *, right: bool = False) -> None:
    plain = text.encode("ascii", "replace").decode()
    width = cv2.getTextSize(plain, _FONT, _FONT_SCALE, 1)[0][0]
    x = at[0] - width if right else at[0]
    cv2.putText(image, plain, (x, at[1]), _FONT, _FONT_SCALE, _WHITE, 1, cv2.LINE_AA)


def _at(point: Float64Array) -> tuple[int, int]:
    return round(float(point[0])), round(float(point[1]))


def _colour(person: int) -> tuple[int, int, int]:
    """Blue, green, red."""
    text = FIGURES[person % len(FIGURES)].lstrip("#")
    return int(text[4:], 16), int(text[2:4], 16), int(text[:2], 16)
