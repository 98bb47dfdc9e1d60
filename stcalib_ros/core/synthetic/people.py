"""People in motion: continuous functions of time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.synthetic.clips import CyclicClip, MotionClip
from stcalib_ros.core.synthetic.gait import ProceduralMotion
from stcalib_ros.core.synthetic.noise import child_rng
from stcalib_ros.core.synthetic.paths import GroundPaths, random_paths
from stcalib_ros.core.synthetic.skeleton import N_JOINTS, individual_lengths

_SAMPLES_PER_S = 60
"""Samples per second of the motion that is interpolated by splines. Numerical."""
_LOCOMOTION_FRACTION = 0.4
"""Fraction of the people of "mocap" scenes that walk; the others move at one place. Chosen."""

PEOPLE = ("mocap", "procedural", "standing", "gesturing", "alike")
"""Kinds of motion there are."""


@dataclass(frozen=True, slots=True, eq=False)
class PersonMotion:
    """The true motion of one person.

    Attributes
    ----------
    spline : CubicSpline
        Joints over reference time, twice continuously differentiable.
    lengths : (17,) ndarray
        Bone lengths, metres.
    """

    spline: CubicSpline
    lengths: Float64Array

    def __call__(self, times: Float64Array) -> Float64Array:
        """Joints (T, 17, 3) in the world, metres, at times of the reference clock."""
        return np.asarray(self.spline(times)).reshape(len(times), N_JOINTS, 3)


def make_people(
    rng: np.random.Generator,
    kind: str,
    n_people: int,
    span_s: tuple[float, float],
    radius: float,
    clips: Sequence[MotionClip],
) -> tuple[PersonMotion, ...]:
    """Make people of one kind of motion, over a span of time.

    Parameters
    ----------
    rng : Generator
    kind : str
        One of `PEOPLE`; "mocap" without clips is "procedural".
    n_people : int
    span_s : (float, float)
        First and last time needed.
    radius : float
        Radius of the area they move in, metres.
    clips : sequence of MotionClip
    """
    n = int(np.ceil((span_s[1] - span_s[0]) * _SAMPLES_PER_S)) + 12
    times = span_s[0] + (np.arange(n) - 6) / _SAMPLES_PER_S
    bodies = [_body(child_rng(rng), kind, clips) for _ in range(n_people)]
    paths = random_paths(
        child_rng(rng),
        times,
        np.array([b.speed for b in bodies]),
        radius,
        pauses=isinstance(bodies[0], ProceduralMotion),
        turning=0.0 if kind == "standing" else 1.0,
    )
    people = tuple(
        _placed(child_rng(rng), body, times, paths, person) for person, body in enumerate(bodies)
    )
    return _alike(people, times) if kind == "alike" else people


def _alike(people: Sequence[PersonMotion], times: Float64Array) -> tuple[PersonMotion, ...]:
    """Move everybody as the first one, each from their own start."""
    first = people[0](times)
    begin = [person(times[:1])[0, 0] * [1.0, 1.0, 0.0] for person in people]
    moved = [(first + place - begin[0]).reshape(len(times), -1) for place in begin]
    return tuple(PersonMotion(CubicSpline(times, path), people[0].lengths) for path in moved)


def _body(
    rng: np.random.Generator, kind: str, clips: Sequence[MotionClip]
) -> CyclicClip | ProceduralMotion:
    if kind == "standing":
        return ProceduralMotion(rng, speed=0.0, liveliness=0.0)
    if kind == "gesturing":
        return ProceduralMotion(rng, speed=0.0, liveliness=1.0)
    if kind in ("procedural", "alike") or not clips:
        return ProceduralMotion(rng, speed=rng.uniform(0.7, 1.3), liveliness=rng.uniform(0.1, 0.4))
    wanted = rng.uniform() < _LOCOMOTION_FRACTION
    pool = [c for c in clips if c.locomotion == wanted] or list(clips)
    return CyclicClip(pool[rng.integers(len(pool))], rng)


def _placed(
    rng: np.random.Generator,
    body: CyclicClip | ProceduralMotion,
    times: Float64Array,
    paths: GroundPaths,
    person: int,
) -> PersonMotion:
    lengths = individual_lengths(rng, body.lengths)
    local = body.joints(times, paths.travelled[:, person], lengths)
    c, s = np.cos(paths.heading[:, person]), np.sin(paths.heading[:, person])
    zero, one = np.zeros_like(c), np.ones_like(c)
    R_world_body = np.stack(
        [np.stack(row, axis=-1) for row in ((c, -s, zero), (s, c, zero), (zero, zero, one))], axis=1
    )
    joints = np.einsum("tab,tjb->tja", R_world_body, local)
    joints[..., :2] += paths.xy[:, person, None]
    return PersonMotion(CubicSpline(times, joints.reshape(len(times), -1)), lengths)
