"""Procedural motion: walking, standing and gesturing on an articulated skeleton."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.synthetic.noise import child_rng, smooth_noise
from stcalib_ros.core.synthetic.skeleton import (
    LAYOUT,
    N_JOINTS,
    PARENTS,
    assemble,
    standard_lengths,
)

_ANKLE_HEIGHT = 0.08
"""Metres. Height of the ankle of a standing foot above the floor. Chosen, of usual anatomy."""
_SIDES = (("left", 1.0), ("right", -1.0))


class ProceduralMotion:
    """Sinusoidal joint angles, with gestures on top.

    Parameters
    ----------
    rng : Generator
        Draws stride, phase, amplitudes and the gestures.
    speed : float
        Walking speed, m/s; 0: stays at one place.
    liveliness : float
        Amplitude of arm gestures and head turns; 0: none, 1: a person telling something.

    Attributes
    ----------
    speed : float
    lengths : (17,) ndarray
        Bone lengths of the standard body.
    """

    def __init__(self, rng: np.random.Generator, *, speed: float, liveliness: float) -> None:
        self.speed = speed
        self.lengths = standard_lengths()
        self._liveliness = liveliness
        self._stride = 1.25 * rng.uniform(0.85, 1.15)
        self._phase = rng.uniform(0, 2 * np.pi)
        self._arm_swing = rng.uniform(0.25, 0.6)
        self._knee_lift = rng.uniform(0.85, 1.15)
        self._elbow = rng.uniform(0.2, 0.6)
        self._rng = child_rng(rng)

    def joints(
        self, times: Float64Array, travelled: Float64Array, lengths: Float64Array
    ) -> Float64Array:
        """Joints (T, 17, 3) in body axes; the arguments are those of `CyclicClip.joints`."""
        phase = 2 * np.pi * travelled / self._stride + self._phase
        speed = np.gradient(travelled, times)
        amplitude = np.tanh(speed / 0.9) * (1.0 if self.speed else 0.0)
        gesture = self._liveliness * smooth_noise(self._rng, times, (10,), 0.3)
        directions = np.zeros((len(times), N_JOINTS, 3))
        pelvis_yaw = 0.12 * amplitude * np.sin(phase)
        trunk_yaw = -0.15 * amplitude * np.sin(phase) + 0.12 * gesture[:, 0]
        self._pose_legs(directions, phase, amplitude, pelvis_yaw)
        _pose_trunk(directions, trunk_yaw, gesture)
        self._pose_arms(directions, phase, amplitude, trunk_yaw, gesture)
        root = np.zeros((len(times), 3))
        root[:, 1] = 0.02 * amplitude * np.sin(phase)
        root[:, 2] = _pelvis_height(directions, lengths)
        return assemble(root, directions, lengths)

    def _pose_legs(
        self, out: Float64Array, phase: Float64Array, amplitude: Float64Array, yaw: Float64Array
    ) -> None:
        for side, sign in _SIDES:
            swing = phase + (0.0 if sign > 0 else np.pi)
            hip = amplitude * (0.42 * np.sin(swing) + 0.05)
            lift = np.maximum(0.0, np.cos(swing)) ** 2 + 0.12
            knee = self._knee_lift * amplitude * 0.95 * lift
            out[:, LAYOUT.index(f"{side}_hip")] = _level(yaw, sign)
            out[:, LAYOUT.index(f"{side}_knee")] = _sagittal(hip)
            out[:, LAYOUT.index(f"{side}_ankle")] = _sagittal(hip - knee)

    def _pose_arms(
        self,
        out: Float64Array,
        phase: Float64Array,
        amplitude: Float64Array,
        yaw: Float64Array,
        gesture: Float64Array,
    ) -> None:
        raised = min(1.0, self._liveliness)
        for k, (side, sign) in enumerate(_SIDES):
            own = gesture[:, 2 + 3 * k : 5 + 3 * k]
            swing = phase + (np.pi if sign > 0 else 0.0)
            forward = self._arm_swing * amplitude * np.sin(swing) + 0.5 * raised + 0.5 * own[:, 0]
            aside = 0.12 + 0.2 * raised + 0.25 * own[:, 1]
            elbow = self._elbow + 0.7 * raised + 0.5 * own[:, 2]
            elbow = elbow + 0.2 * amplitude * np.sin(swing)
            out[:, LAYOUT.index(f"{side}_shoulder")] = _level(yaw, sign)
            out[:, LAYOUT.index(f"{side}_elbow")] = _sagittal(forward, sign * aside)
            out[:, LAYOUT.index(f"{side}_wrist")] = _sagittal(forward + elbow, sign * 0.5 * aside)


def _pose_trunk(out: Float64Array, yaw: Float64Array, gesture: Float64Array) -> None:
    lean = 0.04 + 0.06 * gesture[:, 1]
    aside = 0.06 * gesture[:, 8]
    for name in ("spine", "thorax", "neck"):
        out[:, LAYOUT.index(name)] = np.stack([lean, aside, np.ones_like(lean)], axis=-1)
    turn = yaw + 0.5 * gesture[:, 9]
    out[:, LAYOUT.index("head")] = np.stack(
        [0.35 * np.cos(turn), 0.35 * np.sin(turn), np.ones_like(turn)], axis=-1
    )


def _level(yaw: Float64Array, sign: float) -> Float64Array:
    """Direction to the left (sign 1) or right (-1) of a girdle turned by yaw."""
    return sign * np.stack([-np.sin(yaw), np.cos(yaw), np.zeros_like(yaw)], axis=-1)


def _sagittal(forward: Float64Array, aside: Float64Array | float = 0.0) -> Float64Array:
    """Direction of a limb that hangs down at angle 0; forward and aside in rad."""
    down = np.cos(forward) * np.cos(aside)
    return np.stack(
        [np.sin(forward) * np.cos(aside), np.sin(aside) + np.zeros_like(forward), -down], axis=-1
    )


def _pelvis_height(directions: Float64Array, lengths: Float64Array) -> Float64Array:
    """Height at which the lower ankle stands on the floor, with a smooth change of legs."""
    reach = []
    for side, _ in _SIDES:
        height = np.zeros(len(directions))
        joint = LAYOUT.index(f"{side}_ankle")
        while joint > 0:
            unit = directions[:, joint] / np.linalg.norm(directions[:, joint], axis=-1)[:, None]
            height -= lengths[joint] * unit[:, 2]
            joint = PARENTS[joint]
        reach.append(height)
    sharp = 0.02
    return sharp * np.logaddexp(reach[0] / sharp, reach[1] / sharp) + _ANKLE_HEIGHT
