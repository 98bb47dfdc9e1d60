"""Surfaces with colours and patterns, and their normals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array, IntArray

PATTERNS = ("plain", "cloth", "stripes", "checks", "planks", "books", "poster", "window", "hair")
"""Patterns that the shader knows, by number."""


@dataclass(frozen=True, slots=True)
class Material:
    """Look of a surface.

    Attributes
    ----------
    colour, second : (float, float, float)
        Linear RGB, 0 to 1; the second one is that of stripes and checks.
    pattern : str
        One of `PATTERNS`.
    gloss : float
        0: matt, 1: polished.
    """

    colour: tuple[float, float, float]
    second: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pattern: str = "plain"
    gloss: float = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles with one look a vertex.

    Attributes
    ----------
    vertices : (N, 3) ndarray
        Metres.
    triangles : (F, 3) ndarray of int
    colours, seconds : (N, 3) ndarray
    looks : (N, 2) ndarray
        Number of the pattern, and gloss.
    source : (N,) ndarray of int
        Vertex of the figure that each goes with; -1: none.
    """

    vertices: Float64Array
    triangles: IntArray
    colours: Float64Array
    seconds: Float64Array
    looks: Float64Array
    source: IntArray

    @classmethod
    def of(
        cls,
        vertices: Float64Array,
        quads: IntArray,
        material: Material,
        source: IntArray | None = None,
    ) -> Mesh:
        """Return quadrangles of one material."""
        n = len(vertices)
        look = (float(PATTERNS.index(material.pattern)), material.gloss)
        return cls(
            vertices,
            np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]),
            np.tile(material.colour, (n, 1)),
            np.tile(material.second, (n, 1)),
            np.tile(look, (n, 1)),
            np.full(n, -1) if source is None else source,
        )

    def coloured(self, colours: Float64Array) -> Mesh:
        """Return the same surface in other colours (N, 3)."""
        return replace(self, colours=colours)


def joined(parts: Sequence[Mesh]) -> Mesh:
    """Return several surfaces as one."""
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.triangles + k for part, k in zip(parts, first, strict=False)]),
        np.concatenate([part.colours for part in parts]),
        np.concatenate([part.seconds for part in parts]),
        np.concatenate([part.looks for part in parts]),
        np.concatenate([part.source for part in parts]),
    )


def units(v: Float64Array) -> Float64Array:
    """Return vectors (..., 3) of length 1."""
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12))


def vertex_normals(vertices: Float64Array, faces: IntArray) -> Float64Array:
    """Return unit normals (N, 3), means over the faces (F, 3 or 4) around each vertex."""
    a, b, c = (vertices[faces[:, k]] for k in (0, 1, 2))
    normal = np.cross(b - a, c - a)
    out = np.zeros_like(vertices)
    for k in range(3):
        for corner in range(faces.shape[1]):
            out[:, k] += np.bincount(faces[:, corner], normal[:, k], len(vertices))
    return units(out)


def box(
    centre: Sequence[float], size: Sequence[float], material: Material, turn: float = 0.0
) -> Mesh:
    """Return a box that stands upright, turned about z by `turn`, rad; its edges are sharp."""
    corners, quads = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                corner = np.zeros(3)
                corner[axis], corner[u], corner[v] = sign, a * sign, b
                corners.append(corner)
            quads.append(np.arange(4) + len(corners) - 4)
    c, s = np.cos(turn), np.sin(turn)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    vertices = np.array(corners) * 0.5 * np.asarray(size) @ R.T + np.asarray(centre)
    return Mesh.of(vertices, np.array(quads), material)
