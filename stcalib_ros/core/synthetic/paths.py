"""Paths over the ground: smooth, random and free of collisions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.synthetic.noise import smooth_noise

_PERSONAL_M = 0.9
"""Metres. Distance between people below which they turn away from each other. Chosen."""
_CLOSE_M = 0.65
"""Metres. Distance of the closest approach to somebody ahead for which people slow down. Chosen."""
_MAX_TURN = 2.5
"""Radians per second. Fastest turn of a walking person. Chosen."""
_TURN_DELAY_S = 0.25
"""Seconds. Time constant with which people turn as they intend to. Chosen."""
_SPEED_DELAY_S = 0.4
"""Seconds. Time constant with which people reach the intended speed. Chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class GroundPaths:
    """Where everybody is on the ground.

    Attributes
    ----------
    xy : (T, P, 2) ndarray
        Metres.
    heading : (T, P) ndarray
        Angle of the forward direction from x, rad, continuous.
    travelled : (T, P) ndarray
        Way so far, metres.
    """

    xy: Float64Array
    heading: Float64Array
    travelled: Float64Array


def random_paths(
    rng: np.random.Generator,
    times: Float64Array,
    speeds: Float64Array,
    radius: float,
    *,
    pauses: bool = False,
    turning: float = 1.0,
) -> GroundPaths:
    """Simulate the paths of P people, who keep a distance from each other and from the border.

    Parameters
    ----------
    rng : Generator
    times : (T,) ndarray
        Evenly spaced seconds.
    speeds : (P,) ndarray
        Preferred speeds, m/s; 0: stays at one place and turns slowly.
    radius : float
        Radius of the area, metres.
    pauses : bool
        People stop and start again now and then.
    turning : float
        How much they turn; 0: those who stay look straight ahead.
    """
    step = float(times[1] - times[0])
    xy = _starting_places(rng, len(speeds), radius)
    heading = rng.uniform(-np.pi, np.pi, len(speeds))
    whim = turning * smooth_noise(rng, times, (len(speeds),), 1.0)
    desired = np.tile(speeds, (len(times), 1))
    if pauses:
        desired = desired * _stop_and_go(rng, times, len(speeds))
    moving = speeds > 0
    turn, speed = np.zeros(len(speeds)), desired[0].copy()
    out = [np.empty((len(times), *shape)) for shape in ((len(speeds), 2), (len(speeds),))]
    travelled = np.zeros((len(times), len(speeds)))
    for k in range(len(times)):
        out[0][k], out[1][k] = xy, heading
        wanted_turn, slack = _steer(xy, heading, speed, whim[k], moving, radius)
        turn = turn + step / _TURN_DELAY_S * (wanted_turn - turn)
        speed = speed + step / _SPEED_DELAY_S * (desired[k] * slack - speed)
        heading = heading + step * turn
        xy = xy + step * speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        if k + 1 < len(times):
            travelled[k + 1] = travelled[k] + step * speed
    return GroundPaths(out[0], out[1], travelled)


def _starting_places(rng: np.random.Generator, n: int, radius: float) -> Float64Array:
    """Return the one of many random arrangements with the largest smallest distance."""
    r = 0.85 * radius * np.sqrt(rng.uniform(size=(200, n)))
    a = rng.uniform(-np.pi, np.pi, (200, n))
    places = np.stack([r * np.cos(a), r * np.sin(a)], axis=-1)
    gap = np.linalg.norm(places[:, :, None] - places[:, None], axis=-1)
    gap[:, np.arange(n), np.arange(n)] = np.inf
    best = np.argmax(gap.min(axis=(1, 2))) if n > 1 else 0
    return np.asarray(places[best])


def _stop_and_go(rng: np.random.Generator, times: Float64Array, n: int) -> Float64Array:
    wave = smooth_noise(rng, times, (n,), 1.2)
    return 1 / (1 + np.exp(-6 * (wave + 0.8)))


def _steer(
    xy: Float64Array,
    heading: Float64Array,
    speed: Float64Array,
    whim: Float64Array,
    moving: BoolArray,
    radius: float,
) -> tuple[Float64Array, Float64Array]:
    """Return the intended turn rate (P,), rad/s, and the factor (P,) of the speed."""
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    away, closest_s, gap = _closest_approach(xy, speed[:, None] * ahead)
    push = 2.0 * np.exp((_PERSONAL_M - gap) / 0.25 - closest_s)
    force = np.sum(push[..., None] * away, axis=1)
    outside = np.linalg.norm(xy, axis=-1, keepdims=True) / radius
    force = force - 2.5 * xy / radius * np.clip(3 * (outside - 0.4), 0, 4)
    wish = ahead + force
    error = np.arctan2(
        ahead[:, 0] * wish[:, 1] - ahead[:, 1] * wish[:, 0], np.sum(ahead * wish, axis=-1)
    )
    turn = np.where(moving, 3.0 * error + 0.7 * whim, 0.25 * whim)
    in_front = np.einsum("pqc,pc->pq", xy[None] - xy[:, None], ahead) > 0
    patience = np.where(in_front & (gap < _CLOSE_M), closest_s, np.inf).min(axis=1)
    slack = np.clip((patience - 0.15) / 0.6, 0.0, 1.0)
    return np.clip(turn, -_MAX_TURN, _MAX_TURN), slack


def _closest_approach(
    xy: Float64Array, velocity: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Predict when and how P people pass each other if nobody turns.

    Returns
    -------
    away : (P, P, 2) ndarray
        Unit vectors from the second to the first of a pair at that time.
    closest_s : (P, P) ndarray
        In how many seconds, at most two.
    gap : (P, P) ndarray
        Distance then, metres; inf on the diagonal.
    """
    offset, drift = xy[:, None] - xy[None], velocity[:, None] - velocity[None]
    closest_s = -np.sum(offset * drift, axis=-1) / (np.sum(drift**2, axis=-1) + 1e-6)
    closest_s = np.clip(closest_s, 0.0, 2.0)
    then = offset + closest_s[..., None] * drift
    gap = np.linalg.norm(then, axis=-1)
    away = then / (gap + 1e-9)[..., None]
    np.fill_diagonal(gap, np.inf)
    return away, closest_s, gap
