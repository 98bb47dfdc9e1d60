"""Bias of poses by noise in the velocities, and its compensation.

Where depths are hardly known, noise of the velocities biases the poses as it does the offsets
(`offset_debiasing`), through products with itself. How the gradient changes when as much noise is
added once more says how much of it is due to the first (SIMEX).

References
----------
J. R. Cook and L. A. Stefanski, "Simulation-extrapolation estimation in parametric measurement error
models", 1994.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stcalib_ros.core.bundle.levenberg_marquardt import Motion, PointProblem
from stcalib_ros.core.bundle.normal_equations import backward_solve
from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.offset_debiasing import random_signs
from stcalib_ros.core.bundle.parameters import ParameterLayout
from stcalib_ros.core.bundle.residuals import noise_px
from stcalib_ros.core.bundle.state import BundleState
from stcalib_ros.core.geometry.robust import CAUCHY
from stcalib_ros.core.model.arrays import Float64Array

_STEPS = 12
"""Count. Gauss-Newton steps at most. Numerical: velocities follow each by half."""

_RENEWED = (0, 4)
"""Steps before which the noise is added. Numerical: it changes little."""

_CONVERGED = 0.05
"""Standard deviations. Done when a step moves the cameras by less. Numerical."""

_MAX_COST_RISE = 100.0 / CAUCHY**2
"""Robust cost. Steps that lose more do not settle. Derived: ten standard deviations."""


def debiased_poses(
    obs: Observations, state: BundleState, layout: ParameterLayout, motion: Motion
) -> BundleState:
    """Return a state at its optimum where it would be without noise in the velocities.

    As it is where that does not settle.

    Parameters
    ----------
    obs : Observations
    state : BundleState
        At its optimum.
    layout : ParameterLayout
        Its unknowns.
    motion : callable
        How velocities are read.
    """
    scale, moved = CAUCHY * noise_px(obs, state), state
    bias = np.zeros(layout.size)
    for n in range(_STEPS):
        if n in _RENEWED:
            bias = _bias(obs, moved, scale, layout, motion)
        problem = PointProblem(obs, moved, scale, layout)
        here = problem.reduce(0.0)
        system = replace(here.system, g=here.system.g - bias)
        step = problem.apply_step(replace(here, system=system)).settled()
        if not step.cost < here.cost + _MAX_COST_RISE:
            break
        moved = step.problem.state_of(moved)
        V, A = motion(obs, moved.X, moved.triangulated())
        moved = replace(moved, V=V, A=A)
        if step.length < _CONVERGED:
            return moved
    return state


def _bias(
    obs: Observations, state: BundleState, scale: float, layout: ParameterLayout, motion: Motion
) -> Float64Array:
    """Part (n,) of the gradient that is due to noise in velocities and accelerations."""
    noise = random_signs(obs, state.X.shape[1])
    flat = noise.reshape(-1, 3)
    for block, at in PointProblem(obs, state, scale).linearised():
        flat[block.points] = backward_solve(at.unweighted_factors(), flat[block.points].T).T
    V, A = motion(obs, scale / CAUCHY * noise, state.triangulated())

    def gradient(factor: float) -> Float64Array:
        noisy = replace(state, V=state.V + factor * V, A=state.A + factor * A)
        return PointProblem(obs, noisy, scale, layout).reduce(0.0).system.g

    more, less, now = (gradient(factor) for factor in (1.0, -1.0, 0.0))
    return np.asarray(0.5 * (more + less) - now)
