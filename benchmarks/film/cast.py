"""Who is in the film: four people of different size, sex and clothes, and where they walk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from zipfile import Path as ZipPath

import numpy as np

from benchmarks.film.figures import read_figure
from benchmarks.film.meshes import Material, Mesh
from benchmarks.film.walking import Walker
from benchmarks.film.wardrobe import Clothes, dressed
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.synthetic.clips import CyclicClip
from stcalib_ros.core.synthetic.gait import ProceduralMotion
from stcalib_ros.core.synthetic.paths import random_paths
from stcalib_ros.io.mocap import shipped_clips

_SAMPLES_PER_S = 60
"""Samples per second of the motion that is interpolated by splines. Numerical."""
_RADIUS_M = 2.3
"""Metres. Radius of the area people walk in: that which is free of furniture."""
_SEED = 9
"""Seed of the paths: in this film everybody is hidden for moments and nobody walks through
anybody. Chosen of the first twenty by looking at plans."""


@dataclass(frozen=True, slots=True)
class Character:
    """One person.

    Attributes
    ----------
    targets : dict of str to float
        Shape of the body, see `read_figure`.
    clothes : Clothes
    walks_by_clip : bool
        By the motion capture clip; otherwise by the procedural gait, with stops.
    """

    targets: dict[str, float]
    clothes: Clothes
    walks_by_clip: bool = True


def _shape(sex: str, origin: str, build: str, height: float) -> dict[str, float]:
    tall = "maxheight" if height > 0 else "minheight"
    return {
        f"macrodetails/{origin}-{sex}-young": 1.0,
        f"macrodetails/universal-{sex}-young-{build}": 0.6,
        f"macrodetails/height/{sex}-young-averagemuscle-averageweight-{tall}": abs(height),
    }


CAST = (
    Character(
        _shape("male", "caucasian", "maxmuscle-averageweight", 0.08),
        Clothes(
            shirt=Material((0.05, 0.14, 0.42), pattern="cloth"),
            trousers=Material((0.16, 0.14, 0.11), pattern="cloth"),
            shoes=Material((0.04, 0.03, 0.03), gloss=0.3),
            skin=Material((0.62, 0.37, 0.26), gloss=0.12),
            hair=Material((0.07, 0.04, 0.02), pattern="hair", gloss=0.06),
        ),
    ),
    Character(
        _shape("female", "asian", "averagemuscle-averageweight", 0.12),
        Clothes(
            shirt=Material((0.55, 0.06, 0.07), pattern="cloth"),
            trousers=Material((0.03, 0.03, 0.05), pattern="cloth"),
            shoes=Material((0.5, 0.48, 0.45), gloss=0.2),
            skin=Material((0.66, 0.42, 0.28), gloss=0.12),
            hair=Material((0.015, 0.012, 0.01), pattern="hair", gloss=0.08),
            long_sleeves=True,
            long_hair=True,
        ),
    ),
    Character(
        _shape("male", "african", "averagemuscle-maxweight", 0.0),
        Clothes(
            shirt=Material((0.6, 0.57, 0.5), (0.1, 0.2, 0.14), "stripes"),
            trousers=Material((0.06, 0.09, 0.17), pattern="cloth"),
            shoes=Material((0.2, 0.1, 0.05), gloss=0.3),
            skin=Material((0.16, 0.08, 0.05), gloss=0.2),
            hair=Material((0.012, 0.01, 0.01), pattern="hair"),
            long_sleeves=True,
        ),
        walks_by_clip=False,
    ),
    Character(
        _shape("female", "caucasian", "averagemuscle-minweight", 0.2),
        Clothes(
            shirt=Material((0.1, 0.3, 0.22), (0.45, 0.42, 0.2), "checks"),
            trousers=Material((0.1, 0.17, 0.3), pattern="cloth"),
            shoes=Material((0.5, 0.1, 0.06), gloss=0.2),
            skin=Material((0.68, 0.43, 0.33), gloss=0.12),
            hair=Material((0.3, 0.17, 0.06), pattern="hair", gloss=0.08),
            long_hair=True,
        ),
    ),
)


def walkers(
    bodies: ZipPath, n_people: int, span_s: tuple[float, float], seed: int = _SEED
) -> tuple[list[Walker], list[Mesh]]:
    """Return the first people of the cast as they walk, and their surfaces at rest.

    Parameters
    ----------
    bodies : zipfile.Path
        See `bodies_in`.
    n_people : int
    span_s : (float, float)
        First and last second of the reference clock that is needed.
    seed : int
    """
    rng = np.random.default_rng(seed)
    clip = next(clip for clip in shipped_clips() if clip.name == "dm_walk")
    times = np.arange(span_s[0] - 0.2, span_s[1] + 0.2, 1 / _SAMPLES_PER_S)
    gaits = [
        CyclicClip(clip, rng)
        if one.walks_by_clip
        else ProceduralMotion(rng, speed=1.05, liveliness=0.15)
        for one in CAST[:n_people]
    ]
    speeds = np.array([gait.speed for gait in gaits])
    paths = random_paths(rng, times, speeds, _RADIUS_M)
    figures = [read_figure(bodies, one.targets) for one in CAST[:n_people]]
    people = [
        Walker(figure, gait, times, paths, k)
        for k, (figure, gait) in enumerate(zip(figures, gaits, strict=True))
    ]
    surfaces = [
        dressed(figure, one.clothes) for figure, one in zip(figures, CAST[:n_people], strict=True)
    ]
    return people, surfaces


def ankles(people: Sequence[Walker], time: float) -> Float64Array:
    """Return the ankles (2 P, 3) of everybody at one time."""
    return np.concatenate([person.ankles(np.array([time]))[0] for person in people])
