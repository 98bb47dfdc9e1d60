"""The room: floor, walls, a window and furniture."""

from __future__ import annotations

from benchmarks.film.meshes import Material, Mesh, box, joined

HALF_WIDTH_M, HALF_DEPTH_M, HEIGHT_M = 4.8, 4.3, 3.0
"""Metres. The room from its middle to its walls along x and y, and its height. Chosen."""

_WALL = Material((0.62, 0.6, 0.55), gloss=0.02)
_OAK = Material((0.33, 0.2, 0.1), pattern="planks", gloss=0.12)
_WHITE = Material((0.7, 0.7, 0.68), gloss=0.1)
_DARK = Material((0.05, 0.05, 0.06), gloss=0.3)
_BIRCH = Material((0.5, 0.38, 0.24), gloss=0.15)
_SOFA = Material((0.12, 0.2, 0.22), pattern="cloth")
_SKY = Material((0.93, 0.96, 1.0), pattern="window")


def furnished_room() -> Mesh:
    """Return everything that does not move; the middle of 6 x 5 m is free."""
    x, y, z = HALF_WIDTH_M, HALF_DEPTH_M, HEIGHT_M
    walls = [
        box((0, 0, -0.05), (2 * x, 2 * y, 0.1), _OAK),
        box((0, 0, z + 0.05), (2 * x, 2 * y, 0.1), Material((0.85, 0.85, 0.83))),
        box((x + 0.05, 0, z / 2), (0.1, 2 * y, z), _WALL),
        box((-x - 0.05, 0, z / 2), (0.1, 2 * y, z), Material((0.3, 0.38, 0.42), gloss=0.02)),
        box((0, y + 0.05, z / 2), (2 * x, 0.1, z), _WALL),
        box((0, -y - 0.05, z / 2), (2 * x, 0.1, z), Material((0.55, 0.5, 0.42), gloss=0.02)),
    ]
    return joined([*walls, *_trim(), *_pictures(), *_furniture()])


def _trim() -> list[Mesh]:
    x, y = HALF_WIDTH_M, HALF_DEPTH_M
    return [
        *(box((s * (x - 0.01), 0, 0.06), (0.03, 2 * y, 0.12), _WHITE) for s in (-1, 1)),
        *(box((0, s * (y - 0.01), 0.06), (2 * x, 0.03, 0.12), _WHITE) for s in (-1, 1)),
        box((-x + 0.02, 0.6, 1.6), (0.06, 2.4, 1.5), _WHITE),
        *(box((-x + 0.06, c, 1.6), (0.01, 1.08, 1.34), _SKY) for c in (0.03, 1.17)),
        box((1.9, -y + 0.02, 1.05), (0.95, 0.06, 2.1), Material((0.25, 0.15, 0.08), gloss=0.2)),
        box((1.55, -y + 0.07, 1.05), (0.12, 0.04, 0.03), _DARK),
        *(box((a, b, HEIGHT_M - 0.02), (1.2, 0.35, 0.04), _SKY) for a, b in _LAMP_PLACES),
    ]


_LAMP_PLACES = ((0.6, -0.4), (-2.4, 1.8), (2.2, 2.2))


def _pictures() -> list[Mesh]:
    x, y = HALF_WIDTH_M, HALF_DEPTH_M
    red = Material((0.55, 0.12, 0.08), (0.85, 0.75, 0.5), "poster")
    blue = Material((0.08, 0.2, 0.45), (0.75, 0.8, 0.75), "poster")
    return [
        box((x - 0.02, -1.4, 1.6), (0.04, 1.1, 0.8), red),
        box((x - 0.02, 1.3, 1.65), (0.04, 0.7, 1.0), blue),
        box((-1.2, -y + 0.02, 1.65), (1.3, 0.04, 0.9), blue),
        box((-2.7, y - 0.02, 1.6), (0.8, 0.04, 1.1), red),
    ]


def _furniture() -> list[Mesh]:
    x, y = HALF_WIDTH_M, HALF_DEPTH_M
    books = Material((0.35, 0.27, 0.18), pattern="books")
    return [
        box((1.2, y - 0.2, 1.0), (1.6, 0.34, 2.0), books),
        box((1.2, y - 0.18, 2.02), (1.7, 0.36, 0.05), _BIRCH),
        *_table((x - 0.5, -0.2), (0.75, 1.7)),
        box((x - 0.35, -0.2, 1.02), (0.05, 0.6, 0.36), _DARK),
        box((x - 0.33, -0.2, 0.8), (0.15, 0.2, 0.1), _DARK),
        *_chair((x - 1.15, -0.5), 0.3),
        *_sofa((-3.0, y - 0.55)),
        box((-x + 0.3, -2.4, 0.45), (0.5, 1.4, 0.9), _BIRCH),
        box((-x + 0.35, -2.7, 1.0), (0.25, 0.25, 0.22), Material((0.6, 0.2, 0.1), gloss=0.4)),
        *_plant((-x + 0.5, -y + 0.5)),
        *_chair((-2.9, -y + 0.6), 1.9),
    ]


def _table(at: tuple[float, float], size: tuple[float, float]) -> list[Mesh]:
    a, b = size[0] / 2 - 0.05, size[1] / 2 - 0.05
    legs = [(at[0] + s * a, at[1] + r * b, 0.36) for s in (-1, 1) for r in (-1, 1)]
    top = box((*at, 0.74), (*size, 0.04), _BIRCH)
    return [top, *(box(leg, (0.05, 0.05, 0.72), _WHITE) for leg in legs)]


def _chair(at: tuple[float, float], turn: float) -> list[Mesh]:
    seat = Material((0.45, 0.1, 0.08), pattern="cloth")
    return [
        box((*at, 0.45), (0.44, 0.44, 0.06), seat, turn),
        box((*at, 0.21), (0.07, 0.07, 0.42), _DARK, turn),
        box((*at, 0.03), (0.4, 0.4, 0.05), _DARK, turn),
        box((at[0] - 0.2, at[1] - 0.06, 0.75), (0.05, 0.4, 0.5), seat, turn),
    ]


def _sofa(at: tuple[float, float]) -> list[Mesh]:
    return [
        box((*at, 0.22), (1.9, 0.8, 0.4), _SOFA),
        box((at[0], at[1] + 0.33, 0.55), (1.9, 0.2, 0.5), _SOFA),
        *(box((at[0] + s * 0.9, at[1], 0.38), (0.18, 0.8, 0.5), _SOFA) for s in (-1, 1)),
        box((at[0] - 0.45, at[1] + 0.12, 0.5), (0.42, 0.14, 0.36), Material((0.6, 0.4, 0.08))),
    ]


def _plant(at: tuple[float, float]) -> list[Mesh]:
    leaf = Material((0.05, 0.16, 0.04), pattern="cloth", gloss=0.2)
    pot = box((*at, 0.2), (0.34, 0.34, 0.4), Material((0.5, 0.22, 0.12)))
    leaves = [
        box(
            (at[0] + 0.16 * dx, at[1] + 0.16 * dy, 0.75 + 0.17 * k),
            (0.34, 0.05, 0.5),
            leaf,
            1.1 * k,
        )
        for k, (dx, dy) in enumerate(((1, 0), (-1, 1), (0, -1), (1, 1), (-1, -1)))
    ]
    return [pot, *leaves]
