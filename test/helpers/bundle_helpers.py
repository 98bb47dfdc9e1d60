"""A bundle adjustment small enough to be solved densely, and SciPy's view of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.state import BundleState
from stcalib_ros.core.geometry.so3 import exp_so3

STEP_S = 1 / 30
FOCAL_PX = 1400.0
CAUCHY = 2.385


@dataclass(frozen=True)
class Problem:
    """Observations, and the state that they were made of."""

    o: Observations
    truth: BundleState


def problem(
    rng: np.random.Generator,
    *,
    cameras: int = 3,
    people: int = 2,
    time_bins: int = 8,
    joints: int = 3,
    sigma_px: float = 1.0,
    offset_s: float = 0.004,
    missing: float = 0.15,
    pace_m_s: float = 2.0,
    acceleration: float = 5.0,
    phi_frames: float = 0.5,
) -> Problem:
    """Points under steady acceleration, seen by cameras on an arc with noise of Gauss.

    The first camera is the reference; clocks of the others are still off by up to `offset_s`.
    """
    N = people * time_bins
    person, time_bin = (
        np.repeat(np.arange(people), time_bins),
        np.tile(np.arange(time_bins), people),
    )
    R, t = _arc(rng, cameras)
    start = rng.uniform([-1, -1, 4], [1, 1, 6], (people, joints, 3))
    pace = rng.uniform(-pace_m_s, pace_m_s, (people, joints, 3))
    A = rng.uniform(-acceleration, acceleration, (people, joints, 3))[person]
    elapsed = (time_bin * STEP_S)[:, None, None]
    V = pace[person] + elapsed * A
    X = start[person] + elapsed * (pace[person] + 0.5 * elapsed * A)
    phi = rng.uniform(-phi_frames, phi_frames, (N, cameras)) * STEP_S
    shift = rng.uniform(-offset_s, offset_s, cameras)
    shift[0] = 0
    seen = rng.uniform(size=(N, cameras, joints)) >= missing
    seen &= (seen.sum(1) >= 2)[:, None]
    truth = BundleState(R, t, shift, X, V, A, seen)
    when = (phi + shift)[..., None, None]
    moved = X[:, None] + when * V[:, None] + 0.5 * when**2 * A[:, None]
    Y = np.einsum("cij,ncpj->ncpi", R, moved) + t[:, None]
    focal = np.full(seen.shape, FOCAL_PX) * rng.uniform(0.9, 1.1, seen.shape)
    x = Y[..., :2] / Y[..., 2:] + sigma_px * rng.normal(size=(*seen.shape, 2)) / focal[..., None]
    x[~seen] = 0
    track = np.where(seen.any(-1), person[:, None], -1)
    return Problem(Observations(person, time_bin, track, phi, x, focal, seen, 0.0, STEP_S), truth)


def _arc(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Cameras (R, t: to camera) around a point 5 m ahead of the first, which is the origin."""
    angle = np.linspace(0, 1.5, n)
    R = exp_so3(angle[:, None] * [0.0, 1.0, 0.0])
    R[1:] = exp_so3(0.05 * rng.normal(size=(n - 1, 3))) @ R[1:]
    middle = np.array([0.0, 0.0, 5.0])
    return R, middle - R @ middle


def disturbed(rng: np.random.Generator, state: BundleState, size: float = 0.01) -> BundleState:
    """A start near a state: the reference and the spread of the cameras are kept."""
    R = exp_so3(size * rng.normal(size=state.t_cam_ref.shape)) @ state.R_cam_ref
    t = state.t_cam_ref + size * rng.normal(size=state.t_cam_ref.shape)
    R[0], t[0] = state.R_cam_ref[0], state.t_cam_ref[0]
    t *= state.cameras.length() / replace(state.cameras, R=R, t=t).length()
    shift = state.shift_s + 0.1 * size * rng.normal(size=len(t))
    shift[0] = 0
    X = state.X + size * rng.normal(size=state.X.shape)
    return replace(state, R_cam_ref=R, t_cam_ref=t, shift_s=shift, X=X)


def residuals(p: Problem, state: BundleState) -> np.ndarray:
    """Reprojection residuals (M, 2), px, of all that is used; written out by point and camera."""
    out = []
    for n, c, j in np.argwhere(state.inlier):
        when = p.o.phi[n, c] + state.shift_s[c]
        X = state.X[n, j] + when * state.V[n, j] + 0.5 * when**2 * state.A[n, j]
        Y = state.R_cam_ref[c] @ X + state.t_cam_ref[c]
        out.append((Y[:2] / Y[2] - p.o.x[n, c, j]) * p.o.focal[n, c, j])
    return np.array(out)


def stepped(state: BundleState, d_camera: np.ndarray, d_point: np.ndarray) -> BundleState:
    """A state after steps (C, 7) of the cameras and (N, J, 3) of the points."""
    return replace(
        state,
        R_cam_ref=exp_so3(d_camera[:, :3]) @ state.R_cam_ref,
        t_cam_ref=state.t_cam_ref + d_camera[:, 3:6],
        shift_s=state.shift_s + d_camera[:, 6],
        X=state.X + d_point,
    )
