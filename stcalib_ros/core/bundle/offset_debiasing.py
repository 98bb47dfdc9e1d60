"""What noise in the velocities does to the offsets.

Velocities are read from joint positions that have noise. An image half a frame after its knot sees
the joint where ``X + phi V`` puts it; with noise n in V the gradient by the offset holds
``phi n^2``, which does not average out: offsets are drawn towards whole frames, by one or two
standard deviations in ten seconds. How large n is follows from the normal equations of the joints:
one sample of their noise, read like the velocities, is enough, as thousands of joints are summed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigvalsh

from stcalib_ros.core.bundle.levenberg_marquardt import (
    PointProblem,
    adjust,
    reduced_by_group,
    solve_reduced,
)
from stcalib_ros.core.bundle.normal_equations import (
    CAMERA,
    ReducedSystem,
    backward_solve,
    forward_solve,
)
from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.residuals import errors_px, robust_scale
from stcalib_ros.core.bundle.state import BundleState, estimate_motion
from stcalib_ros.core.geometry.robust import CAUCHY, MIN_SCALE_PX
from stcalib_ros.core.model.arrays import BoolArray, Float64Array

_UNSURE = 10.0
_MOST = 0.9
_MOSTLY = 0.5
_STEPS = 2


@dataclass(frozen=True, slots=True, eq=False)
class VelocityNoise:
    """Share of the noise in the normal equations of the offsets, in units of `ReducedSystem`.

    Attributes
    ----------
    H : (C, C) ndarray
    g : (C,) ndarray
        At the corrections of the offsets `shift_s`.
    shift_s : (C,) ndarray
    present : (N, J) ndarray of bool
        Joints that are told well enough to read velocities from: those in line with the only two
        cameras that see them are not.
    """

    H: Float64Array
    g: Float64Array
    shift_s: Float64Array
    present: BoolArray

    def share(self, system: ReducedSystem) -> float:
        """Largest part of what a system knows of any combination of offsets that is noise."""
        offsets = CAMERA * np.arange(1, len(self.g)) + CAMERA - 1
        H = system.H[np.ix_(offsets, offsets)]
        H = H + 1e-12 * np.trace(H) * np.eye(len(H)) + 1e-30 * np.eye(len(H))
        return float(eigvalsh(self.H[1:, 1:], H)[-1])

    def subtract_from(self, system: ReducedSystem, shift_s: Float64Array) -> ReducedSystem:
        """The system without it, at other corrections (C,) of the offsets.

        A tenth of what is known of any offset is left.
        """
        part = min(1.0, _MOST / max(self.share(system), 1e-30))
        offsets = CAMERA * np.arange(len(self.g)) + CAMERA - 1
        H, g = system.H.copy(), system.g.copy()
        H[np.ix_(offsets, offsets)] -= part * self.H
        g[offsets] -= part * (self.g + self.H @ (shift_s - self.shift_s))
        return ReducedSystem(H, g)


def velocity_noise(o: Observations, state: BundleState, scale: float) -> VelocityNoise:
    """The noise of velocities that are read from the joints of a state, Cauchy scale in px."""
    problem = PointProblem(o, state, scale)
    variance, noise = np.full(state.used.shape[::2], np.inf), _signs(o, state.X.shape[1])
    flat_variance, flat_noise = variance.reshape(-1), noise.reshape(-1, 3)
    for block, at in problem.linearised():
        factors = at.unweighted_factors()
        unit = np.eye(3)[:, :, None] * np.ones(len(block.points))
        flat_variance[block.points] = (forward_solve(factors, unit) ** 2).sum((0, 1))
        flat_noise[block.points] = backward_solve(factors, flat_noise[block.points].T).T
    known = np.isfinite(variance)
    present = known & (variance < _UNSURE * np.median(variance[known]))
    V = estimate_motion(o, scale / CAUCHY * noise, present)[0].reshape(-1, 3)
    C = len(state.t_cam_ref)
    H, g = np.zeros((C, C)), np.zeros(C)
    for block, at in problem.linearised():
        h, y, _ = at.by_time(scale, V[block.points].T)
        when = block.phi + state.shift_s[:, None]
        flat = y.transpose(1, 0, 2).reshape(C, -1)
        H += np.diag(h.sum(1)) - flat @ flat.T
        g += (h * when).sum(1) - flat @ (y * when).sum(1).ravel()
    return VelocityNoise(H, g, state.shift_s, np.asarray(present))


def _signs(o: Observations, J: int) -> Float64Array:
    """Random signs (N, J, 3), those of one knot the same for all persons, whatever their order."""
    since = o.knot - o.knot.min()
    drawn = np.random.default_rng(0).integers(0, 2, (int(since.max()) + 1, J, 3))
    return np.asarray(2.0 * drawn[since] - 1.0)


def debiased(o: Observations, state: BundleState) -> BundleState:
    """A state at its optimum, moved to where it would be without noise in the velocities.

    As it is where most of what is known of some offset is noise.
    """
    scale = robust_scale(errors_px(o, state), state.used) * CAUCHY
    if state.synchronised or not scale > CAUCHY * MIN_SCALE_PX:
        return state
    noise = velocity_noise(o, state, scale)
    moved = _reread(o, state, noise.present)
    for _ in range(_STEPS):
        problem = PointProblem(o, moved, scale)
        reduced = problem.reduce(0.0)
        if noise.share(reduced.system) > _MOSTLY:
            return state
        calm = replace(reduced, system=noise.subtract_from(reduced.system, moved.shift_s))
        moved = _reread(o, problem.moved(calm).problem.state_of(moved), noise.present)
    return moved


def _reread(o: Observations, state: BundleState, present: BoolArray) -> BundleState:
    V, A = estimate_motion(o, state.X, present)
    return replace(state, V=V, A=A)


_HALF_WINDOW_S = 0.25


_DRAWN_FRAMES = 0.1
"""More than what smoothing does to the offsets of people who walk."""


_FURTHEST_FRAMES = 0.5


_SETTLED_FRAMES = 0.01


_PASSES = 6


def with_smoothed_velocities(o: Observations, state: BundleState) -> BundleState:
    """The state with velocities and accelerations over half a second."""
    V, A = estimate_motion(o, state.X, state.used.sum(1) >= 2, smooth_s=_HALF_WINDOW_S)
    return replace(state, V=V, A=A)


def velocity_noise_fraction(state: BundleState, calm: BundleState) -> float:
    """Energy of what calmer velocities leave away, over their own: noise, if there is much of it.

    Offsets are drawn by about that share of the way to the nearest whole frame.
    """
    known = state.used.sum(1) >= 2
    left_away, left = (state.V - calm.V)[known], calm.V[known]
    return float((left_away**2).sum() / max(float((left**2).sum()), 1e-12))


def offset_bias_s(o: Observations, calm: BundleState) -> Float64Array:
    """By how much offsets (C,) move in the first step with calmer velocities, seconds."""
    one_group = np.zeros(len(o.person), dtype=np.int64)
    H, g = reduced_by_group(o, calm, one_group)
    system = ReducedSystem(H[0], g[0])
    step = solve_reduced(system, calm.t_cam_ref, synchronised=calm.synchronised)
    return np.asarray(-step[:, 6])


def debias_offsets(o: Observations, state: BundleState, *, iterations: int) -> BundleState:
    """The state adjusted with calmer velocities, if noise in them has drawn its offsets."""
    calm = with_smoothed_velocities(o, state)
    if (
        state.synchronised
        or velocity_noise_fraction(state, calm) < _DRAWN_FRAMES / _FURTHEST_FRAMES
    ):
        return state
    if np.abs(offset_bias_s(o, calm)).max() < _DRAWN_FRAMES * o.step_s:
        return state
    for _ in range(_PASSES):
        before = state.shift_s
        state = adjust(o, with_smoothed_velocities(o, state), iterations=iterations, tolerance=0.5)
        if np.abs(state.shift_s - before).max() < _SETTLED_FRAMES * o.step_s:
            break
    return state
