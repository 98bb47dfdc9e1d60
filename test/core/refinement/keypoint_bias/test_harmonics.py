"""How people are turned, and the harmonics of it."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS, layout_from_names
from stcalib_ros.core.refinement.keypoint_bias.harmonics import (
    DEGREE_OF,
    body_frames,
    harmonics,
    trunk_of,
)
from stcalib_ros.core.synthetic.skeleton import LAYOUT


def sphere():
    """Directions (3, M) and weights (M,) that integrate polynomials of degree seven exactly."""
    z, weight = np.polynomial.legendre.leggauss(6)
    angle = np.arange(12) * np.pi / 6
    ring = np.sqrt(1 - z**2)[:, None] * np.stack([np.cos(angle), np.sin(angle)])[:, None]
    u = np.concatenate([ring, np.broadcast_to(z[:, None], (1, 6, 12))])
    return u.reshape(3, -1), np.repeat(weight, 12) / 24


def test_harmonics_are_orthonormal_and_have_no_constant_part():
    u, weight = sphere()
    h = harmonics(u)
    assert len(h) == len(DEGREE_OF)
    np.testing.assert_allclose(h @ weight, 0.0, atol=1e-12)
    np.testing.assert_allclose((h * weight) @ h.T, np.eye(len(h)), atol=1e-12)


def person(rng):
    X = rng.normal(scale=0.1, size=(5, LAYOUT.n_joints, 3))
    for name, place in (
        ("left_hip", (0, 0.1, 0.9)),
        ("right_hip", (0, -0.1, 0.9)),
        ("left_shoulder", (0, 0.2, 1.4)),
        ("right_shoulder", (0, -0.2, 1.4)),
    ):
        X[:, LAYOUT.index(name)] = place
    return X


def test_axes_of_a_person_who_stands_along_the_frame():
    trunk = trunk_of(LAYOUT)
    R, direction = body_frames(person(np.random.default_rng(0)), trunk, np.array([[3, 0, 1.15]]))
    np.testing.assert_allclose(R, np.tile(np.eye(3)[:, :, None], 5), atol=1e-12)
    np.testing.assert_allclose(direction[:, 0], np.tile([[1], [0], [0]], 5), atol=1e-12)


def test_where_a_camera_stands_does_not_depend_on_the_frame():
    rng = np.random.default_rng(1)
    X, centres, trunk = person(rng), rng.normal(scale=4.0, size=(3, 3)), trunk_of(LAYOUT)
    turn, shift = exp_so3(rng.normal(size=3)), rng.normal(size=3)
    R, direction = body_frames(X, trunk, centres)
    R_new, direction_new = body_frames(X @ turn.T + shift, trunk, centres @ turn.T + shift)
    np.testing.assert_allclose(direction_new, direction, atol=1e-12)
    np.testing.assert_allclose(R_new, np.einsum("ab,bcn->acn", turn, R), atol=1e-12)


def test_layouts_without_a_trunk_are_told():
    assert all(trunk_of(layout) is not None for layout in LAYOUTS.values())
    assert trunk_of(layout_from_names(["nose", "left_wrist", "right_wrist"])) is None
