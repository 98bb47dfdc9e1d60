"""Images show things where the lens and the clock of the camera say."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.film import shoot
from benchmarks.film.cameras import CAMERAS, FilmCamera
from benchmarks.film.figures import Figure
from benchmarks.film.meshes import Material, box
from benchmarks.film.walking import Pose
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.model.arrays import Float64Array

_AT = np.array([0.4, -0.3, 1.3])
_SPEED = np.array([0.9, 1.3, 0.0])
"""Metres per second. Velocity of the ball."""


class _Ball:
    """A bright thing that flies."""

    figure = Figure(np.zeros((1, 3)), {}, np.ones((1, 1)), np.zeros((1, 3)), {})

    def pose(self, times: Float64Array) -> Pose:
        return Pose(np.tile(np.eye(3), (len(times), 1, 1, 1)), self.at(times)[:, None])

    def at(self, times: Float64Array) -> Float64Array:
        return np.asarray(_AT + times[:, None] * _SPEED)

    def ankles(self, times: Float64Array) -> Float64Array:
        return np.full((len(times), 2, 3), -9.0)


def _surface() -> object:
    mesh = box((0, 0, 0), (0.05, 0.05, 0.05), Material((1, 0, 1), pattern="window"))
    return type(mesh)(
        mesh.vertices,
        mesh.triangles,
        mesh.colours,
        mesh.seconds,
        mesh.looks,
        np.zeros(len(mesh.vertices), dtype=int),
    )


@pytest.mark.parametrize("camera", [CAMERAS[1], CAMERAS[3]], ids=lambda camera: camera.name)
def test_a_thing_is_seen_where_it_was_at_the_time_of_its_row(camera: FilmCamera) -> None:
    try:
        shooting = shoot.Shooting(camera, [_Ball()], [_surface()])
    except InputError as error:
        pytest.skip(str(error))
    start = 0.2
    image = shooting.image(start - camera.offset_s).astype(float)
    purple = np.clip(np.minimum(image[..., 0], image[..., 2]) - image[..., 1] - 120, 0, None)
    rows, columns = np.indices(purple.shape)
    seen = np.array([(purple * columns).sum(), (purple * rows).sum()]) / purple.sum()
    R, t = camera.pose
    time = start + camera.line_time_s * seen[1]
    expected = project(_Ball().at(np.array([time]))[0] @ R.T + t, camera.lens)
    assert np.allclose(seen, expected, atol=0.3)
