"""What people wear: clothes, skin and hair over a figure, as meshes with colours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.film.figures import BONE_NAMES, Figure
from benchmarks.film.meshes import Material, Mesh, joined, vertex_normals
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray

_HEM_M = 0.05
"""Metres. Length by which a shirt hangs over the hips. Chosen."""
_WAIST_M = 0.1
"""Metres. Height of the top of trousers above the hips. Chosen."""
_SHOE_M = 0.095
"""Metres. Height of the top of a shoe at rest, above the soles. Chosen: below the ankle."""
_SHORT_SLEEVE = 0.75
"""Fraction of the upper arm that a short sleeve covers. Chosen."""
_COLLAR_M = 0.055
"""Metres. Height of the collar above the shoulders. Chosen."""
_SCALP = 0.35
"""Slope of the hairline: metres of height a metre of depth, forehead above nape. Chosen."""
_LONG_HAIR_M = 0.06
"""Metres. Length of long hair below the shoulder joints. Chosen."""
_FOREHEAD_M = 0.045
"""Metres. Height above the eyes where the hair begins. Of the mesh of the hair."""
_BROW_M = (0.017, 0.004)
"""Metres. Half width and half height of an eyebrow. Chosen."""
_LIP_M = (0.024, 0.009)
"""Metres. Half width and half height of the lips. Chosen."""
_SHORT_HAIR_M = 0.014
"""Metres. Thickness of short hair. Chosen."""


@dataclass(frozen=True, slots=True)
class Clothes:
    """Colours of one person.

    Attributes
    ----------
    shirt, trousers, shoes, skin, hair : Material
    long_sleeves, long_hair, skirt : bool
        A skirt is worn over trousers that are tight, in the colour of the shoes.
    """

    shirt: Material
    trousers: Material
    shoes: Material
    skin: Material
    hair: Material
    long_sleeves: bool = False
    long_hair: bool = False
    skirt: bool = False


def dressed(figure: Figure, clothes: Clothes) -> Mesh:
    """Return the surface of a person at rest; `Mesh.source` says which vertex of the figure."""
    tights = figure.faces["helper-tights"]
    place = figure.vertices[tights].mean(axis=1)
    bone = _dominant(figure, tights)
    hips = figure.landmarks["left_hip"][2]
    legs = _is(bone, "pelvis", "spine_01", "thigh", "calf", "foot") & (
        place[:, 2] < hips + _WAIST_M
    )
    shoes = _is(bone, "foot", "ball") | (place[:, 2] < _SHOE_M)
    trunk = _is(bone, "pelvis", "spine", "clavicle", "neck", "thigh")
    trunk &= (place[:, 2] > hips - _HEM_M) & ~_above_collar(figure, place)
    shirt = trunk | _sleeves(figure, place, bone, long=clothes.long_sleeves)
    tight = 0.004 if clothes.skirt else 0.013
    parts = [
        _layer(figure, tights[legs & ~shoes], clothes.trousers, tight),
        _layer(figure, tights[shoes], clothes.shoes, 0.009),
        _layer(figure, tights[shirt], clothes.shirt, 0.018),
        _skin(figure, clothes),
        _hair(figure, clothes),
        *(_eye(figure, side) for side in ("left", "right")),
    ]
    if clothes.skirt:
        skirt = figure.faces["helper-skirt"]
        knee = figure.landmarks["left_knee"][2]
        upper = figure.vertices[skirt].mean(axis=1)[:, 2] > knee - 0.02
        parts.append(_layer(figure, skirt[upper], clothes.shirt, 0.02))
    return joined(parts)


def _dominant(figure: Figure, faces: IntArray) -> IntArray:
    return np.asarray(figure.weights[faces].sum(axis=1).argmax(axis=1))


def _is(bone: IntArray, *names: str) -> BoolArray:
    some = [k for k, name in enumerate(BONE_NAMES) if name.startswith(names)]
    return np.isin(bone, some)


def _above_collar(figure: Figure, place: Float64Array) -> BoolArray:
    collar = figure.landmarks["left_shoulder"][2] + _COLLAR_M
    return np.asarray(place[:, 2] > collar - 0.35 * (place[:, 0] - place[:, 0].mean()))


def _sleeves(figure: Figure, place: Float64Array, bone: IntArray, *, long: bool) -> BoolArray:
    if long:
        return _is(bone, "upperarm", "lowerarm")
    out = _is(bone, "upperarm")
    for side, sign in (("left", 1.0), ("right", -1.0)):
        shoulder = figure.landmarks[f"{side}_shoulder"]
        arm = figure.landmarks[f"{side}_elbow"] - shoulder
        along = (place - shoulder) @ arm / (arm @ arm)
        out &= (along < _SHORT_SLEEVE) | (np.sign(place[:, 1]) != sign)
    return out


def _layer(figure: Figure, quads: IntArray, material: Material, thickness: float) -> Mesh:
    """Return quadrangles of a figure moved outwards along their normals."""
    source, flat = np.unique(quads, return_inverse=True)
    faces = flat.reshape(quads.shape)
    vertices = figure.vertices[source]
    vertices = vertices + thickness * vertex_normals(vertices, faces)
    return Mesh.of(vertices, faces, material, source=source)


def _skin(figure: Figure, clothes: Clothes) -> Mesh:
    body = figure.faces["body"]
    place, bone = figure.vertices[body].mean(axis=1), _dominant(figure, body)
    bare = _is(bone, "head", "neck", "hand")
    bare |= _is(bone, "spine_03", "clavicle") & (
        place[:, 2] > figure.landmarks["left_shoulder"][2] - 0.02
    )
    if not clothes.long_sleeves:
        bare |= _is(bone, "lowerarm", "upperarm")
    mesh = _layer(figure, body[bare], clothes.skin, 0.0)
    colours = mesh.colours.copy()
    for side in ("left", "right"):
        brow = figure.landmarks[f"{side}_eye"] + [0.02, 0.0, 0.022]
        colours[_near(mesh.vertices, brow, _BROW_M)] *= 0.4
    eyes = 0.5 * (figure.landmarks["left_eye"] + figure.landmarks["right_eye"])
    lips = np.array([figure.landmarks["nose"][0], 0.0, eyes[2] - 0.075])
    colours[_near(mesh.vertices, lips, _LIP_M)] *= [0.85, 0.55, 0.55]
    return mesh.coloured(colours)


def _near(vertices: Float64Array, centre: Float64Array, half: tuple[float, float]) -> BoolArray:
    shift = vertices - centre
    inside = (shift[:, 1] / half[0]) ** 2 + (shift[:, 2] / half[1]) ** 2
    return np.asarray((inside < 1) & (np.abs(shift[:, 0]) < 0.04))


def _hair(figure: Figure, clothes: Clothes) -> Mesh:
    if clothes.long_hair:
        quads = figure.faces["helper-hair"]
        place = figure.vertices[quads].mean(axis=1)
        long = place[:, 2] > figure.landmarks["left_shoulder"][2] - _LONG_HAIR_M
        ear, eye = figure.landmarks["left_ear"], figure.landmarks["left_eye"]
        face = (place[:, 0] > ear[0] + 0.01) & (place[:, 2] < eye[2] + _FOREHEAD_M)
        quads = quads[long & ~face]
        return _layer(figure, quads, clothes.hair, 0.004)
    body = figure.faces["body"]
    place = figure.vertices[body].mean(axis=1) - figure.landmarks["left_ear"]
    above = place[:, 2] > 0.015 + _SCALP * place[:, 0] + np.where(place[:, 0] > 0.06, 0.03, 0.0)
    behind = (place[:, 2] > -0.035) & (place[:, 0] < -0.015)
    head = _is(_dominant(figure, body), "head") & (above | behind)
    return _layer(figure, body[head], clothes.hair, _SHORT_HAIR_M)


def _eye(figure: Figure, side: str) -> Mesh:
    white, iris = (0.75, 0.73, 0.7), (0.08, 0.05, 0.03)
    mesh = _layer(figure, figure.faces[f"helper-{side[0]}-eye"], Material(white, gloss=0.5), 0.0)
    front = mesh.vertices[:, 0].max() - mesh.vertices[:, 0]
    colours = np.where((front < 0.004)[:, None], iris, mesh.colours)
    return mesh.coloured(colours)
