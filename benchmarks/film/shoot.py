"""Take the images of one camera: the room through its lens, people at the time of each row."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from benchmarks.film.cameras import HEIGHT, WIDTH, FilmCamera
from benchmarks.film.cast import ankles
from benchmarks.film.meshes import Mesh
from benchmarks.film.renderer import Renderer
from benchmarks.film.room import furnished_room
from benchmarks.film.walking import Walker, skinned
from stcalib_ros.core.geometry.lens import bearings, project
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.estimation.poses import UInt8Array

_FINER = 1.3
"""Pixels drawn for one pixel of the image, along each axis: the lens is applied to them. Chosen."""
_NOISE = 1.2
"""Grey levels. Standard deviation of the noise of the sensor: a webcam's in a lit room."""
_BLUR_PX = 0.6
"""Pixels. Standard deviation of the blur of lens and sensor. Chosen."""


class Shooting:
    """One camera in the room.

    Parameters
    ----------
    camera : FilmCamera
    people : sequence of Walker
    surfaces : sequence of Mesh
        Of the people, at rest.
    """

    def __init__(
        self, camera: FilmCamera, people: Sequence[Walker], surfaces: Sequence[Mesh]
    ) -> None:
        self._camera, self._people, self._surfaces = camera, people, surfaces
        self._K, size, self._at = _drawn_lens(camera)
        self._renderer = Renderer(furnished_room(), surfaces, size)

    def image(self, stamp: float) -> UInt8Array:
        """Return the image (height, width, 3), blue first, at a stamp of the camera's clock."""
        start = stamp + self._camera.offset_s
        R, t = self._camera.pose
        people = [
            self._surface(person, mesh, start)
            for person, mesh in zip(self._people, self._surfaces, strict=True)
        ]
        drawn = self._renderer.image(self._K, R, t, people, ankles(self._people, start))
        image = cv2.remap(drawn, *self._at, cv2.INTER_LINEAR)
        image = cv2.GaussianBlur(image, (0, 0), _BLUR_PX)
        rng = np.random.default_rng(round(start * 1e6) + 10**9)
        noisy = image + rng.normal(0.0, _NOISE, (HEIGHT, WIDTH, 1))
        return np.clip(np.round(noisy), 0, 255).astype(np.uint8)[..., ::-1]

    def _surface(self, person: Walker, mesh: Mesh, start: float) -> Float64Array:
        """Return the vertices, each at the time of the row that it is seen in."""
        lines = self._camera.line_time_s
        times = np.array([start, start + lines * HEIGHT]) if lines else np.array([start])
        moved = skinned(person.figure, person.pose(times), mesh.source, mesh.vertices)
        if not lines:
            return np.asarray(moved[0])
        R, t = self._camera.pose
        rows = project(moved.mean(axis=0) @ R.T + t, self._camera.lens)[:, 1]
        share = np.clip(np.nan_to_num(rows) / HEIGHT, 0.0, 1.0)[:, None]
        return np.asarray((1 - share) * moved[0] + share * moved[1])


def take(shooting: Shooting, stamps: Float64Array, folder: Path) -> int:
    """Write the images that are not there yet as ``000000.png``; return how many were taken."""
    folder.mkdir(parents=True, exist_ok=True)
    taken = 0
    for k, stamp in enumerate(stamps):
        path = folder / f"{k:06d}.png"
        if path.exists():
            continue
        partial = path.with_suffix(".part.png")
        cv2.imwrite(str(partial), shooting.image(float(stamp)), [cv2.IMWRITE_PNG_COMPRESSION, 1])
        partial.rename(path)
        taken += 1
    return taken


def _drawn_lens(
    camera: FilmCamera,
) -> tuple[Float64Array, tuple[int, int], tuple[Float64Array, Float64Array]]:
    """Return a pinhole that sees as much: K, size, and where each pixel lies in its image."""
    grid = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), axis=-1).astype(float)
    rays = bearings(grid, camera.lens)[0]
    first, last = rays.min(axis=(0, 1)), rays.max(axis=(0, 1))
    focal = _FINER * camera.focal_px
    width, height = np.ceil((last - first) * focal).astype(int) + 3
    K = np.array([[focal, 0, 1 - first[0] * focal], [0, focal, 1 - first[1] * focal], [0, 0, 1]])
    at = (rays * focal + K[:2, 2]).astype(np.float32)
    return K, (int(width), int(height)), (at[..., 0], at[..., 1])
