"""Draw the room and the people by OpenGL, without a screen and without a graphics card."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.film.meshes import Mesh, units, vertex_normals
from benchmarks.film.shaders import FRAGMENT, SHADOW_FRAGMENT, SHADOW_VERTEX, VERTEX
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.estimation.poses import UInt8Array

if TYPE_CHECKING:
    import moderngl

_SHADOW_PX = 1024
"""Pixels. Width of the shadow maps: 1 cm on the floor of a room of 9 m. Chosen."""
_NEAR_M, _FAR_M = 0.1, 20.0
"""Metres. Nearest and farthest point that is drawn: beyond the walls of the room."""
_LAMPS = np.array([[0.6, -0.4, 2.85], [-2.4, 1.8, 2.85], [2.2, 2.2, 2.85]])
_SUN = units(np.array([-0.75, -0.45, 0.55]))


class Renderer:
    """Draws images of one size.

    Parameters
    ----------
    room : Mesh
    people : sequence of Mesh
        At rest.
    size : (int, int)
        Width and height, px.

    Raises
    ------
    InputError
        There is no moderngl, or no OpenGL.
    """

    def __init__(self, room: Mesh, people: Sequence[Mesh], size: tuple[int, int]) -> None:
        self._gl = _context()
        self._gl.enable(self._gl.DEPTH_TEST)
        self._program = self._gl.program(VERTEX, FRAGMENT)
        self._shadow_program = self._gl.program(SHADOW_VERTEX, SHADOW_FRAGMENT)
        self._target = self._gl.framebuffer(
            self._gl.renderbuffer(size, 3), self._gl.depth_renderbuffer(size)
        )
        self._maps = [self._gl.depth_texture((_SHADOW_PX, _SHADOW_PX)) for _ in range(2)]
        self._map_buffers = [self._gl.framebuffer(depth_attachment=m) for m in self._maps]
        for unit_number, depth in enumerate(self._maps):
            depth.compare_func = "<="
            depth.use(unit_number)
            self._program[f"shadows{unit_number}"] = unit_number
        lights = [_lamp_view(), _sun_view()]
        self._lights = [_bytes(m) for m in lights]
        self._program["lights"].write(b"".join(self._lights))
        self._program["lamps"].write(_LAMPS.astype("f4").tobytes())
        self._program["sun"].write(_SUN.astype("f4").tobytes())
        self._room = _Drawn(self._gl, self._program, self._shadow_program, room)
        self._people = [_Drawn(self._gl, self._program, self._shadow_program, p) for p in people]
        self.size = size

    def image(
        self,
        K: Float64Array,
        R_cam_world: Float64Array,
        t_cam_world: Float64Array,
        people: Sequence[Float64Array],
        feet: Float64Array,
    ) -> UInt8Array:
        """Return an image (height, width, 3), RGB, of a pinhole camera.

        Parameters
        ----------
        K : (3, 3) ndarray
        R_cam_world, t_cam_world : (3, 3) and (3,) ndarray
        people : sequence of (N, 3) ndarray
            Vertices of every person in the world, metres.
        feet : (N, 3) ndarray
            Ankles, at most eight; the floor is darker around them.
        """
        for drawn, vertices in zip(self._people, people, strict=True):
            drawn.move(vertices)
        everything = [self._room, *self._people]
        for light, target in zip(self._lights, self._map_buffers, strict=True):
            target.use()
            target.clear()
            self._shadow_program["light"].write(light)
            for drawn in everything:
                drawn.shadow.render()
        padded = np.full((8, 3), -99.0)
        padded[: len(feet)] = feet
        self._program["feet"].write(padded.astype("f4").tobytes())
        self._program["camera"].write(_bytes(self._view(K, R_cam_world, t_cam_world)))
        self._program["eye"].write((-R_cam_world.T @ t_cam_world).astype("f4").tobytes())
        self._target.use()
        self._target.clear(0.1, 0.1, 0.1)
        for drawn in everything:
            self._program["moving"] = float(drawn is not self._room)
            drawn.surface.render()
        pixels = np.frombuffer(self._target.read(components=3, alignment=1), dtype=np.uint8)
        return pixels.reshape(self.size[1], self.size[0], 3)[::-1]

    def _view(
        self, K: Float64Array, R_cam_world: Float64Array, t_cam_world: Float64Array
    ) -> Float64Array:
        """Return the matrix (4, 4) from the world to OpenGL's clip space."""
        width, height = self.size
        scale = (_FAR_M + _NEAR_M) / (_FAR_M - _NEAR_M)
        projection = np.zeros((4, 4))
        projection[0] = [2 * K[0, 0] / width, 0, 2 * (K[0, 2] + 0.5) / width - 1, 0]
        projection[1] = [0, -2 * K[1, 1] / height, 1 - 2 * (K[1, 2] + 0.5) / height, 0]
        projection[2] = [0, 0, scale, -2 * _FAR_M * _NEAR_M / (_FAR_M - _NEAR_M)]
        projection[3, 2] = 1
        T_cam_world = np.eye(4)
        T_cam_world[:3, :3], T_cam_world[:3, 3] = R_cam_world, t_cam_world
        return np.asarray(projection @ T_cam_world)


def _context() -> moderngl.Context:
    try:
        import moderngl
    except ModuleNotFoundError:
        raise InputError("no moderngl: pip install -r requirements/film.txt") from None
    try:
        return moderngl.create_standalone_context(backend="egl")
    except Exception as error:  # moderngl raises nothing narrower
        raise InputError(
            f"no OpenGL without a screen ({error}): apt-get install libegl1 libgl1-mesa-dri"
        ) from error


class _Drawn:
    """A surface on the side of OpenGL."""

    def __init__(
        self,
        gl: moderngl.Context,
        program: moderngl.Program,
        shadow_program: moderngl.Program,
        mesh: Mesh,
    ) -> None:
        self._triangles: IntArray = mesh.triangles
        index = gl.buffer(mesh.triangles.astype("i4").tobytes())
        n = len(mesh.vertices)
        self._moving = gl.buffer(reserve=n * 24, dynamic=True)
        look = np.concatenate([mesh.vertices, mesh.colours, mesh.seconds, mesh.looks], axis=1)
        fixed = gl.buffer(look.astype("f4").tobytes())
        self.surface = gl.vertex_array(
            program,
            [
                (self._moving, "3f 3f", "position", "normal"),
                (fixed, "3f 3f 3f 2f", "rest", "colour", "second", "look"),
            ],
            index,
        )
        self.shadow = gl.vertex_array(shadow_program, [(self._moving, "3f 12x", "position")], index)
        self.move(mesh.vertices)

    def move(self, vertices: Float64Array) -> None:
        normals = vertex_normals(vertices, self._triangles)
        self._moving.write(np.concatenate([vertices, normals], axis=1).astype("f4").tobytes())


def _bytes(matrix: Float64Array) -> bytes:
    return bytes(np.asarray(matrix).T.astype("f4").tobytes())


def _looking(eye: Float64Array, forward: Float64Array) -> Float64Array:
    right = units(np.cross(forward, [0.0, 1.0, 0.1]))
    R = np.stack([right, np.cross(forward, right), forward])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, -R @ eye
    return T


def _lamp_view() -> Float64Array:
    """Return the view from the first lamp: downwards, 130 degrees."""
    spread = 1 / np.tan(np.radians(65))
    near, far = 0.3, 8.0
    projection = np.diag([spread, spread, (far + near) / (far - near), 0.0])
    projection[2, 3], projection[3, 2] = -2 * far * near / (far - near), 1.0
    return np.asarray(projection @ _looking(_LAMPS[0], np.array([0.0, 0.0, -1.0])))


def _sun_view() -> Float64Array:
    """Return the parallel view from the window."""
    projection = np.diag([1 / 5.5, 1 / 5.5, 1 / 9.0, 1.0])
    return np.asarray(projection @ _looking(np.array([0.0, 0.0, 1.0]), -_SUN))
