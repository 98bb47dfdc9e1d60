"""Bias of the time offsets by noise in the velocities, and its compensation.

Velocities are read from joint positions that have noise. An image half a frame after its time bin
observes the joint at ``X + phi V``; with noise n in V the gradient by the offset holds ``phi n^2``,
which does not average out: offsets are biased towards whole frames, by one or two standard
deviations in ten seconds. How large n is follows from the normal equations of the joints: one
sample of their noise, read like the velocities, is enough, as thousands of joints are summed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigvalsh

from stcalib_ros.core.bundle.levenberg_marquardt import Motion, PointProblem, adjust
from stcalib_ros.core.bundle.limits import (
    MAX_NOISE_FRACTION,
    MAX_NOISE_SUBTRACTED,
    MAX_POINT_VARIANCE,
    MIN_BIAS_FRAMES,
    MIN_NOISE_ENERGY,
    OFFSET_CONVERGED_FRAMES,
    SMOOTHED_TOLERANCE,
)
from stcalib_ros.core.bundle.normal_equations import ReducedSystem, backward_solve, forward_solve
from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.parameters import (
    TIME_OFFSET,
    ParameterLayout,
)
from stcalib_ros.core.bundle.residuals import errors_px, noise_px, robust_scale
from stcalib_ros.core.bundle.state import BundleState, estimate_motion
from stcalib_ros.core.geometry.robust import CAUCHY, MIN_SCALE_PX
from stcalib_ros.core.model.arrays import BoolArray, Float64Array

_MAX_LENS_DEVIATIONS = 3.0
"""Standard deviations. A lens that noise in the velocities would move by more keeps its values.
Measured: on default scenes they move by one, and principal points are better for it by a third; on
wide ones they moved by five, 13 px, and were worse."""
_STEPS = 2
"""Count. Gauss-Newton steps without the noise. Numerical: the second moves by a tenth of the
first."""

_PASSES = 6
"""Count. Adjustments with smoothed velocities at most. Numerical."""

_SMOOTHING_S = 0.25
"""Seconds. Half window of smoothed velocities: half a step of a person who walks. Longer windows
bias the offsets of people who walk by more than `MIN_BIAS_FRAMES`."""


@dataclass(frozen=True, slots=True, eq=False)
class VelocityNoise:
    """Part of noise in the normal equations of the time offsets, in units of `ReducedSystem`.

    Attributes
    ----------
    H : (C, C) ndarray
    g : (C,) ndarray
        At the corrections of the offsets `shift_s`.
    shift_s : (C,) ndarray
    present : (N, J) ndarray of bool
        Joints that are determined well enough to read velocities from: those in line with the only
        two cameras that observe them are not.
    """

    H: Float64Array
    g: Float64Array
    shift_s: Float64Array
    present: BoolArray

    def fraction(self, system: ReducedSystem, layout: ParameterLayout) -> float:
        """Largest fraction of what a system knows of any combination of offsets that is noise."""
        offsets = layout.scalars(TIME_OFFSET)[1:]
        H = system.H[np.ix_(offsets, offsets)]
        H = H + 1e-12 * np.trace(H) * np.eye(len(H)) + 1e-30 * np.eye(len(H))
        return float(eigvalsh(self.H[1:, 1:], H)[-1])

    def subtract_from(
        self, system: ReducedSystem, layout: ParameterLayout, shift_s: Float64Array
    ) -> ReducedSystem:
        """The system without it, at other corrections (C,) of the offsets.

        A tenth of what is known of any offset is left.
        """
        part = min(1.0, MAX_NOISE_SUBTRACTED / max(self.fraction(system, layout), 1e-30))
        offsets = layout.scalars(TIME_OFFSET)
        H, g = system.H.copy(), system.g.copy()
        H[np.ix_(offsets, offsets)] -= part * self.H
        g[offsets] -= part * (self.g + self.H @ (shift_s - self.shift_s))
        return ReducedSystem(H, g)


def velocity_noise(
    obs: Observations, state: BundleState, scale: float, motion: Motion = estimate_motion
) -> VelocityNoise:
    """Estimate the noise of velocities that are read from the joints of a state.

    Parameters
    ----------
    obs : Observations
    state : BundleState
    scale : float
        Of the Cauchy weights, px.
    motion : callable
        How velocities are read.
    """
    problem = PointProblem(obs, state, scale)
    variance, noise = np.full(state.inlier.shape[::2], np.inf), random_signs(obs, state.X.shape[1])
    flat_variance, flat_noise = variance.reshape(-1), noise.reshape(-1, 3)
    for block, at in problem.linearised():
        factors = at.unweighted_factors()
        unit = np.eye(3)[:, :, None] * np.ones(len(block.points))
        flat_variance[block.points] = (forward_solve(factors, unit) ** 2).sum((0, 1))
        flat_noise[block.points] = backward_solve(factors, flat_noise[block.points].T).T
    known = np.isfinite(variance)
    present = known & (variance < MAX_POINT_VARIANCE * np.median(variance[known]))
    V = motion(obs, scale / CAUCHY * noise, present)[0].reshape(-1, 3)
    C = len(state.t_cam_ref)
    H, g = np.zeros((C, C)), np.zeros(C)
    for block, at in problem.linearised():
        h, y, _ = at.by_time(scale, V[block.points].T)
        when = block.phi + problem.cameras.delay(block.times)
        flat = y.transpose(1, 0, 2).reshape(C, -1)
        H += np.diag(h.sum(1)) - flat @ flat.T
        g += (h * when).sum(1) - flat @ (y * when).sum(1).ravel()
    return VelocityNoise(H, g, state.shift_s, np.asarray(present))


def random_signs(obs: Observations, J: int) -> Float64Array:
    """Random signs (N, J, 3), the same for all persons of a time bin, whatever their order."""
    since = obs.time_bin - obs.time_bin.min()
    sample = np.random.default_rng(0).integers(0, 2, (int(since.max()) + 1, J, 3))
    return np.asarray(2.0 * sample[since] - 1.0)


def debiased(obs: Observations, state: BundleState) -> BundleState:
    """Return a state at its optimum where it would be without noise in the velocities.

    As it is where most of what is known of some offset is noise. Lenses keep their values where
    they would move by more than can be told of them.
    """
    scale = robust_scale(errors_px(obs, state), state.inlier) * CAUCHY
    if state.synchronised or not scale > CAUCHY * MIN_SCALE_PX:
        return state
    noise = velocity_noise(obs, state, scale)
    moved = _without_noise(obs, state, noise, scale, state.layout)
    if state.lenses is None or _lens_deviations(obs, state, moved, scale) < _MAX_LENS_DEVIATIONS:
        return moved
    return _without_noise(obs, state, noise, scale, state.layout.without_lenses())


def _without_noise(
    obs: Observations,
    state: BundleState,
    noise: VelocityNoise,
    scale: float,
    layout: ParameterLayout,
) -> BundleState:
    moved = _with_velocities(obs, state, noise.present)
    for _ in range(_STEPS):
        problem = PointProblem(obs, moved, scale, layout)
        reduced = problem.reduce(0.0)
        if noise.fraction(reduced.system, layout) > MAX_NOISE_FRACTION:
            return state
        system = noise.subtract_from(reduced.system, layout, moved.shift_s)
        step = problem.apply_step(replace(reduced, system=system))
        moved = _with_velocities(obs, step.problem.state_of(moved), noise.present)
    return moved


def _lens_deviations(
    obs: Observations, state: BundleState, moved: BundleState, scale: float
) -> float:
    """How far a lens has moved, in standard deviations of what keypoints tell of it."""
    problem, layout = PointProblem(obs, state, scale), state.layout
    P = layout.inverse(problem.reduce(0.0).system.H, problem.cameras)
    stddev = np.sqrt(np.maximum(np.diag(P), 0.0)) * scale / CAUCHY
    deviations = [0.0]
    for unknown in layout.further:
        if unknown.row is not None:
            known = stddev[layout.scalars(unknown)]
            step = moved.cameras.value(unknown) - state.cameras.value(unknown)
            deviations.append(float((np.abs(step[known > 0.0]) / known[known > 0.0]).max()))
    return max(deviations)


def _with_velocities(obs: Observations, state: BundleState, present: BoolArray) -> BundleState:
    V, A = estimate_motion(obs, state.X, present)
    return replace(state, V=V, A=A)


def with_smoothed_velocities(obs: Observations, state: BundleState) -> BundleState:
    """Return the state with velocities and accelerations over half a second."""
    V, A = estimate_motion(obs, state.X, state.triangulated(), smooth_s=_SMOOTHING_S)
    return replace(state, V=V, A=A)


def velocity_noise_fraction(state: BundleState, smoothed: BundleState) -> float:
    """Energy of what smoothing removes from velocities, over what it leaves.

    Mostly noise where it is large. Offsets are biased by about that fraction of the way to the
    nearest whole frame.
    """
    known = state.triangulated()
    removed, left = (state.V - smoothed.V)[known], smoothed.V[known]
    return float((removed**2).sum() / max(float((left**2).sum()), 1e-12))


def offset_bias_s(obs: Observations, smoothed: BundleState) -> Float64Array:
    """Displacement (C,) of the offsets by the first step with smoothed velocities, s."""
    problem = PointProblem(obs, smoothed, CAUCHY * noise_px(obs, smoothed))
    system, layout = problem.reduce(0.0).system, problem.layout
    step = layout.solve(system.H, system.g, problem.cameras)
    return np.asarray(-step.ravel()[layout.scalars(TIME_OFFSET)])


def debias_offsets(obs: Observations, state: BundleState, *, iterations: int) -> BundleState:
    """Return the state adjusted with smoothed velocities, if noise in them biases its offsets."""
    smoothed = with_smoothed_velocities(obs, state)
    low_motion = velocity_noise_fraction(state, smoothed) >= MIN_NOISE_ENERGY
    if state.synchronised or not low_motion:
        return state
    if np.abs(offset_bias_s(obs, smoothed)).max() < MIN_BIAS_FRAMES * obs.step_s:
        return state
    for _ in range(_PASSES):
        before, start = state.shift_s, with_smoothed_velocities(obs, state)
        state = adjust(obs, start, iterations=iterations, tolerance=SMOOTHED_TOLERANCE)
        if np.abs(state.shift_s - before).max() < OFFSET_CONVERGED_FRAMES * obs.step_s:
            break
    return state
