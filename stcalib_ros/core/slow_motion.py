"""Clock offsets from people who hardly move.

A point that is free at every knot takes the noise of its images along, and so do the velocities
read from it. Where these are noise for the most part, they explain the images best if no time
passes between the knots and the images: offsets stay near the whole frames that they began with.
Velocities over half a second have less noise, but smooth what fast limbs do; so they are only
taken where they say that the offsets were drawn.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stcalib_ros.core import stba
from stcalib_ros.core.observations import Observations
from stcalib_ros.core.reduction import ReducedSystem
from stcalib_ros.core.types import FloatArray

_HALF_WINDOW_S = 0.25
_DRAWN_FRAMES = 0.1
"""More than what smoothing does to the offsets of people who walk."""
_FURTHEST_FRAMES = 0.5
_SETTLED_FRAMES = 0.01
_PASSES = 6


def calmed(o: Observations, state: stba.BundleState) -> stba.BundleState:
    """The state with velocities and accelerations over half a second."""
    V, A = stba.motion(o, state.X, state.used.sum(1) >= 2, smooth_s=_HALF_WINDOW_S)
    return replace(state, V=V, A=A)


def noise_share(state: stba.BundleState, calm: stba.BundleState) -> float:
    """Energy of what calmer velocities leave away, over their own: noise, if there is much of it.

    Offsets are drawn by about that share of the way to the nearest whole frame.
    """
    known = state.used.sum(1) >= 2
    left_away, left = (state.V - calm.V)[known], calm.V[known]
    return float((left_away**2).sum() / max(float((left**2).sum()), 1e-12))


def drawn_s(o: Observations, calm: stba.BundleState) -> FloatArray:
    """By how much offsets (C,) move in the first step with calmer velocities, seconds."""
    one_group = np.zeros(len(o.person), dtype=np.int64)
    H, g = stba.reduced_by_group(o, calm, one_group)
    system = ReducedSystem(H[0], g[0])
    step = stba.solve_reduced(system, calm.t_cam_ref, synchronised=calm.synchronised)
    return np.asarray(-step[:, 6])


def put_back(o: Observations, state: stba.BundleState, *, iterations: int) -> stba.BundleState:
    """The state adjusted with calmer velocities, if noise in them has drawn its offsets."""
    calm = calmed(o, state)
    if state.synchronised or noise_share(state, calm) < _DRAWN_FRAMES / _FURTHEST_FRAMES:
        return state
    if np.abs(drawn_s(o, calm)).max() < _DRAWN_FRAMES * o.step_s:
        return state
    for _ in range(_PASSES):
        before = state.shift_s
        state = stba.adjust(o, calmed(o, state), iterations=iterations, tolerance=0.5)
        if np.abs(state.shift_s - before).max() < _SETTLED_FRAMES * o.step_s:
            break
    return state
