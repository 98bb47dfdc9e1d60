"""Two views of the same points, and cameras made of given keypoints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from core_helpers import true_rig

from stcalib_ros.core.geometry.so3 import exp_so3, hat
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack
from stcalib_ros.core.model.relative_pose import RelativePose, relative_pose
from stcalib_ros.core.synthetic import Scene

FOCAL_PX = 1000.0
STEP_S = 1 / 32
"""Time between images, a binary fraction, so that sums of it are exact."""


def random_pose(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """R_a_b and t_a_b of two cameras a metre apart that look the same way, to 0.4 rad."""
    turn, t_a_b = rng.normal(size=(2, 3))
    angle = rng.uniform(0.0, 0.4)
    return exp_so3(angle * turn / np.linalg.norm(turn)), t_a_b / np.linalg.norm(t_a_b)


def projected(points: np.ndarray) -> np.ndarray:
    """Homogeneous image points of points of an optical frame (..., 3)."""
    return points / points[..., 2:]


def random_views(
    rng: np.random.Generator, n: int = 30
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (n, 3) in two optical frames, and the essential matrix between them."""
    R_a_b, t_a_b = random_pose(rng)
    x_a = rng.uniform([-1, -1, 3], [1, 1, 6], (n, 3))
    return projected(x_a), projected((x_a - t_a_b) @ R_a_b), hat(t_a_b) @ R_a_b


def direction_error(t: np.ndarray, true_t: np.ndarray) -> float:
    """Angle between two vectors, rad."""
    cosine = t @ true_t / np.linalg.norm(t) / np.linalg.norm(true_t)
    return float(np.arccos(np.clip(cosine, -1, 1)))


def matrix_error(E: np.ndarray, truth: np.ndarray) -> float:
    """Distance of two matrices that are known up to a factor."""
    one, other = E / np.linalg.norm(E), truth / np.linalg.norm(truth)
    return float(min(np.linalg.norm(one - other), np.linalg.norm(one + other)))


def track_of(x: np.ndarray, first: int = 0, track_id: int = 0) -> LiftedTrack:
    """A track of keypoints (F, J, 2) on the plane z = 1, from a frame on."""
    unknown = np.full((*x.shape[:2], 3), np.nan)
    frames = first + np.arange(len(x))
    focal = np.full(x.shape[:2], FOCAL_PX)
    return LiftedTrack(track_id, frames, x, focal, unknown, unknown[:, 0])


def camera_of(tracks: Sequence[LiftedTrack], *, name: str = "camera") -> LiftedCamera:
    """A camera with an image every `STEP_S`."""
    n = max((int(track.frames[-1]) + 1 for track in tracks), default=2)
    return LiftedCamera(name, np.arange(n) * STEP_S, tuple(tracks))


def true_pair(scene: Scene, a: int, b: int) -> RelativePose:
    """The true relative pose of two cameras of a scene without exchanged ids, with its matches."""
    here, there = (
        {int(own[0]): i for i, own in enumerate(scene.track_persons[camera.name].values())}
        for camera in (scene.recording.cameras[a], scene.recording.cameras[b])
    )
    matches = tuple((here[p], there[p]) for p in here if p in there)
    return relative_pose(true_rig(scene), a, b, matches)
