"""Simulated scenes of weak geometry: cameras that know depths badly.

Their people are those of the default scenes, 4.5 m away. Cameras may be refused; the standard
deviations of those that are not have to hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from benchmarks.accuracy.scenarios import Scenario
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.core.synthetic import SceneOptions
from stcalib_ros.core.synthetic.rigs import SceneRig

_WIDTH, _HEIGHT = 1920, 1080
_DISTANCE_M = 4.5


def _rig(centres: Sequence[Sequence[float]], ahead: Float64Array, *, focal_px: float) -> SceneRig:
    """Level cameras at centres (C, 3) that look along directions (C, 3)."""
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    R = np.stack([right, np.cross(ahead, right), ahead], 1)
    K = np.array([[focal_px, 0, _WIDTH / 2], [0, focal_px, _HEIGHT / 2], [0, 0, 1.0]])
    lens = Intrinsics(_WIDTH, _HEIGHT, LensModel.PLUMB_BOB, K, np.zeros(5))
    t = -np.einsum("cij,cj->ci", R, np.asarray(centres, dtype=float))
    return SceneRig(tuple(f"cam{c}" for c in range(len(t))), (lens,) * len(t), R, t)


def _row(n: int, step_m: float) -> SceneRig:
    """Cameras beside each other that look the same way."""
    x = step_m * (np.arange(n) - (n - 1) / 2)
    centres = [[one, -_DISTANCE_M, 1.2] for one in x]
    return _rig(centres, np.tile([0.0, 1.0, 0.0], (n, 1)), focal_px=1400.0)


def _pole(step_m: float) -> SceneRig:
    """One camera above another."""
    centres = [[0.0, -_DISTANCE_M, 1.0], [0.0, -_DISTANCE_M, 1.0 + step_m]]
    return _rig(centres, np.tile([0.0, 1.0, 0.0], (2, 1)), focal_px=1400.0)


def _facing() -> SceneRig:
    """Two cameras that look at each other."""
    centres = [[0.0, -_DISTANCE_M, 1.2], [0.0, _DISTANCE_M, 1.2]]
    return _rig(centres, np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]), focal_px=1400.0)


def _weak(name: str, title: str, rig: SceneRig, **options: float) -> Scenario:
    scene = SceneOptions(seed=9000, rig=rig, **options)  # type: ignore[arg-type]
    return Scenario(name, title, scene, 20, Fraction(0), may_refuse=True)


WEAK = (
    _weak("side by side", "two cameras 60 cm apart that look the same way", _row(2, 0.6)),
    _weak("stereo", "two such cameras 30 cm apart, 1 px", _row(2, 0.3), sigma_px=1.0),
    _weak("row of four", "four such cameras, 30 cm from each to the next", _row(4, 0.3)),
    _weak("pole", "two cameras, one 1 m above the other", _pole(1.0)),
    _weak("facing", "two cameras that look at each other", _facing()),
)
