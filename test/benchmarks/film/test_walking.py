"""Figures that walk, with a body of the fewest vertices."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.film.figures import BONE_NAMES, LANDMARK_BONES, Figure
from benchmarks.film.walking import Walker, skinned
from stcalib_ros.core.synthetic.clips import CyclicClip
from stcalib_ros.core.synthetic.paths import random_paths
from stcalib_ros.io.mocap import shipped_clips

_TIMES = np.arange(0, 4, 1 / 60)


def _figure() -> Figure:
    """Return a body whose vertices are its joints and, below them, two soles."""
    at = {
        "pelvis": (0, 0, 0.95),
        "spine_01": (0, 0, 1.05),
        "spine_02": (0, 0, 1.15),
        "spine_03": (0, 0, 1.25),
        "neck_01": (0, 0, 1.5),
        "head": (0, 0, 1.6),
    }
    right = {
        "clavicle": (0, -0.03, 1.42),
        "upperarm": (0, -0.18, 1.4),
        "lowerarm": (0, -0.38, 1.2),
        "hand": (0.1, -0.55, 1.05),
        "thigh": (0, -0.1, 0.92),
        "calf": (0.02, -0.12, 0.5),
        "foot": (0, -0.14, 0.08),
        "ball": (0.14, -0.14, 0.02),
    }
    for name, (x, y, z) in right.items():
        at[f"{name}_r"], at[f"{name}_l"] = (x, y, z), (x, -y, z)
    heads = np.array([at[name] for name in BONE_NAMES], dtype=float)
    soles = [BONE_NAMES.index(name) for name in ("foot_l", "foot_r", "ball_l", "ball_r")]
    vertices = np.concatenate([heads, heads[soles] * [1, 1, 0]])
    weights = np.eye(len(BONE_NAMES))[[*range(len(BONE_NAMES)), *soles]]
    landmarks = {name: heads[BONE_NAMES.index(bone)] for name, bone in LANDMARK_BONES.items()}
    return Figure(vertices, {}, weights, heads, landmarks)


@pytest.fixture(scope="module")
def walker() -> Walker:
    rng = np.random.default_rng(2)
    clip = next(clip for clip in shipped_clips() if clip.name == "dm_walk")
    gait = CyclicClip(clip, rng)
    paths = random_paths(rng, _TIMES, np.array([gait.speed]), 2.0)
    return Walker(_figure(), gait, _TIMES, paths, 0)


def test_bones_keep_their_lengths_and_rotations_are_rotations(walker: Walker) -> None:
    pose = walker.pose(_TIMES)
    assert np.allclose(np.linalg.det(pose.R_world_bone), 1.0)
    joints = walker.landmarks(_TIMES)
    names = list(LANDMARK_BONES)
    for a, b in (("left_hip", "left_knee"), ("right_elbow", "right_wrist")):
        now = np.linalg.norm(joints[:, names.index(a)] - joints[:, names.index(b)], axis=-1)
        rest = walker.figure.landmarks[a] - walker.figure.landmarks[b]
        assert np.allclose(now, np.linalg.norm(rest))


def test_the_lower_foot_stands_on_the_floor(walker: Walker) -> None:
    times = _TIMES[20:-20]
    soles = np.arange(len(BONE_NAMES), len(walker.figure.vertices))
    lowest = skinned(walker.figure, walker.pose(times), soles)[..., 2].min(axis=1)
    assert np.abs(lowest).max() < 0.02
    ankles = walker.ankles(times)
    assert np.all(np.ptp(ankles[..., 2], axis=0) > 0.1)


def test_people_face_the_way_they_go_with_the_left_side_left(walker: Walker) -> None:
    joints = walker.landmarks(_TIMES)
    names = list(LANDMARK_BONES)
    hips = joints[:, [names.index("left_hip"), names.index("right_hip")]]
    way = np.gradient(hips.mean(axis=1), axis=0)[:, :2]
    left = (hips[:, 0] - hips[:, 1])[:, :2]
    assert np.mean(way[:, 0] * left[:, 1] - way[:, 1] * left[:, 0] > 0) > 0.95
