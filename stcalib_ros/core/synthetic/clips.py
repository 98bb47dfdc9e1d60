"""Motion capture clips, made cyclic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.synthetic.skeleton import N_JOINTS, assemble, body_axes, bones_of

_BLEND_S = 0.5
"""Seconds over which the end of a clip at one place fades into its beginning. Chosen."""
_MAX_SPEED = 1.8
"""Metres per second. Faster locomotion is played more slowly: people of a scene walk. Chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class MotionClip:
    """One recorded motion of one person.

    Attributes
    ----------
    name : str
    fps : float
    joints : (F, 17, 3) ndarray
        Joints in Human3.6M's order, metres, z up, floor at 0.
    locomotion : bool
        The person gets ahead (a whole number of cycles of walking or running); otherwise the
        motion is played at one place.
    """

    name: str
    fps: float
    joints: Float64Array
    locomotion: bool

    def __post_init__(self) -> None:
        if self.joints.ndim != 3 or self.joints.shape[1:] != (N_JOINTS, 3):
            raise InputError(
                f"clip {self.name!r}: expected joints of shape (F, 17, 3), got {self.joints.shape}"
            )
        if len(self.joints) < 2 * _BLEND_S * self.fps and not self.locomotion:
            raise InputError(f"clip {self.name!r}: shorter than {2 * _BLEND_S} s")
        if not (self.fps > 0 and np.isfinite(self.joints).all()):
            raise InputError(f"clip {self.name!r}: fps must be above 0 and all joints finite")


class CyclicClip:
    """A clip without its way over the ground and without a seam, in body axes (x forward).

    Parameters
    ----------
    clip : MotionClip
    rng : Generator
        Draws the phase and the speed of playback.

    Attributes
    ----------
    speed : float
        Speed over the ground, m/s, of the recorded body; 0 for motions at one place.
    lengths : (17,) ndarray
        Bone lengths of the recorded body.
    """

    def __init__(self, clip: MotionClip, rng: np.random.Generator) -> None:
        joints = clip.joints @ _heading_removed(clip).T
        directions, self.lengths = bones_of(joints)
        drift = joints[-1, 0, :2] - joints[0, 0, :2]
        duration = (len(joints) - 1) / clip.fps
        root = joints[:, 0].copy()
        root[:, :2] -= np.linspace(0, 1, len(root))[:, None] * drift + root[0, :2]
        flat = np.concatenate([root, directions.reshape(len(root), -1)], axis=1)
        cycle = _ramped(flat) if clip.locomotion else _crossfaded(flat, round(_BLEND_S * clip.fps))
        cycle[:, :2] -= cycle[:-1, :2].mean(axis=0)
        self._spline = CubicSpline(np.arange(len(cycle)) / clip.fps, cycle, bc_type="periodic")
        self._period = (len(cycle) - 1) / clip.fps
        recorded = float(np.linalg.norm(drift)) / duration if clip.locomotion else 0.0
        self._rate = rng.uniform(0.9, 1.1) * min(1.0, _MAX_SPEED / max(recorded, 1e-9))
        self._phase = rng.uniform(0, self._period)
        self._recorded_speed = recorded
        self.speed = recorded * self._rate

    def joints(
        self, times: Float64Array, travelled: Float64Array, lengths: Float64Array
    ) -> Float64Array:
        """Joints (T, 17, 3) in body axes above the ground point.

        Parameters
        ----------
        times : (T,) ndarray
            Seconds.
        travelled : (T,) ndarray
            Way along the path so far, metres; drives the phase of locomotion.
        lengths : (17,) ndarray
            Bone lengths of the person.
        """
        size = lengths[[2, 3]].sum() / self.lengths[[2, 3]].sum()
        way = travelled / (size * self._recorded_speed) if self._recorded_speed else None
        clock = times * self._rate if way is None else way
        flat = self._spline(np.mod(clock + self._phase, self._period))
        return assemble(flat[:, :3] * size, flat[:, 3:].reshape(-1, N_JOINTS, 3), lengths)


def _heading_removed(clip: MotionClip) -> Float64Array:
    """Rotation about z that makes the person head along x on average."""
    if clip.locomotion:
        ahead = clip.joints[-1, 0] - clip.joints[0, 0]
    else:
        ahead = body_axes(clip.joints)[:, 0].mean(axis=0)
    c, s = ahead[:2] / max(float(np.linalg.norm(ahead[:2])), 1e-9)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def _ramped(flat: Float64Array) -> Float64Array:
    """Cycle whose small gap between last and first frame is spread over all frames."""
    out: Float64Array = flat - np.linspace(0, 1, len(flat))[:, None] * (flat[-1] - flat[0])
    out[-1] = out[0]
    return out


def _crossfaded(flat: Float64Array, n_blend: int) -> Float64Array:
    """Cycle whose last frames fade into its first ones."""
    weight = np.linspace(0, 1, n_blend)[:, None]
    weight = weight**2 * (3 - 2 * weight)
    head = (1 - weight) * flat[-n_blend:] + weight * flat[:n_blend]
    return np.concatenate([head, flat[n_blend:-n_blend], head[:1]])
