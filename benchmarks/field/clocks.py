"""Kinds A and G: clocks that are not one offset, and stamps that are not regular."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.field.case import Case, Member, simulated
from benchmarks.field.changes import keep_images, with_stamps
from stcalib_ros.core.synthetic import SceneOptions

_LENGTH = 600
"""Images. Twenty seconds: a step has ten on either side."""
_LONG = 1800
"""Images. A minute, as rates need it."""


def _base(seed: int, *, n_cameras: int = 4, n_frames: int = _LENGTH) -> Case:
    return simulated(SceneOptions(seed=20_000 + seed, n_cameras=n_cameras, n_frames=n_frames))


def _stepped(
    seed: int,
    *,
    camera: str = "cam1",
    steps: tuple[tuple[float, float], ...],
    n_cameras: int = 4,
) -> Case:
    case = _base(seed, n_cameras=n_cameras)
    stamps = case.camera(camera).stamps.copy()
    for at, by_s in steps:
        stamps[round(at * len(stamps)) :] += by_s
    kept = np.concatenate([[True], stamps[1:] > np.maximum.accumulate(stamps)[:-1]])
    return keep_images(case, camera, kept, stamps[kept])


def _slewed(seed: int) -> Case:
    case = _base(seed)
    stamps = case.camera("cam1").stamps
    slew = np.interp(stamps, [5.0, 15.0], [0.0, 0.1])
    return with_stamps(case, "cam1", stamps + slew)


def _dropped(seed: int, *, burst: int = 1) -> Case:
    """Lose three percent of the images, and number those that are left."""
    case = _base(seed, n_frames=900)
    stamps = case.camera("cam1").stamps
    rng = np.random.default_rng([seed, burst])
    kept = np.repeat(rng.random(len(stamps) // burst + 1) > 0.03, burst)[: len(stamps)]
    kept[0] = True
    return keep_images(case, "cam1", kept, stamps[: kept.sum()])


def _fast(seed: int, ppm: float, *, camera: str = "cam1", n_cameras: int = 4) -> Case:
    case = _base(seed, n_frames=_LONG, n_cameras=n_cameras)
    stamps = case.camera(camera).stamps
    return with_stamps(case, camera, stamps[0] + (stamps - stamps[0]) / (1.0 + ppm * 1e-6))


def _boot_clock(seed: int) -> Case:
    case = _base(seed)
    return with_stamps(case, "cam1", case.camera("cam1").stamps - 1_759_900_000.0)


def _bunched(seed: int, n: int, gap_s: float, cameras: tuple[str, ...]) -> Case:
    case = _base(seed, n_frames=300)
    for name in cameras:
        stamps = case.camera(name).stamps
        row = np.arange(len(stamps))
        last = np.minimum(row // n * n + n - 1, len(stamps) - 1)
        case = with_stamps(case, name, stamps[last] + 0.04 + row % n * gap_s)
    return case


def _gap(seed: int, gap_s: float) -> Case:
    """Let the clock of a camera be set once, early: the rest is right."""
    case = _base(seed, n_frames=300)
    stamps = case.camera("cam1").stamps.copy()
    stamps[:3] -= gap_s
    return with_stamps(case, "cam1", stamps)


def _jittered(seed: int) -> Case:
    case = simulated(SceneOptions(seed=20_500 + seed, stamp_jitter_s=0.004))
    return replace(case, faulty=frozenset())


def _steps(*steps: tuple[float, float]) -> tuple[tuple[float, float], ...]:
    return steps


_ALL = ("cam0", "cam1", "cam2", "cam3")

CLOCKS = (
    Member("A", "step of 100 ms", lambda s: _stepped(s, steps=_steps((0.5, 0.1)))),
    Member("A", "step of 40 ms", lambda s: _stepped(s, steps=_steps((0.6, 0.04)))),
    Member("A", "there and back", lambda s: _stepped(s, steps=_steps((0.3, 0.1), (0.6, -0.1)))),
    Member("A", "step, reference", lambda s: _stepped(s, camera="cam0", steps=_steps((0.5, -0.1)))),
    Member("A", "step, two cameras", lambda s: _stepped(s, steps=_steps((0.5, 0.1)), n_cameras=2)),
    Member("A", "slew of 100 ms", _slewed),
    Member("A", "lost images numbered", _dropped),
    Member("A", "lost bursts numbered", lambda s: _dropped(s, burst=4)),
    Member("A", "rate 1000 ppm", lambda s: _fast(s, 1000.0)),
    Member("A", "rate 300 ppm, two cameras", lambda s: _fast(s, 300.0, n_cameras=2)),
    Member("A", "rate 1000 ppm, reference", lambda s: _fast(s, -1000.0, camera="cam0")),
    Member("A", "clock since boot", _boot_clock),
    Member("G", "bunches of three", lambda s: _bunched(s, 3, 0.0005, ("cam1",))),
    Member("G", "bunches of two", lambda s: _bunched(s, 2, 0.012, ("cam1",))),
    Member("G", "bunches, all cameras", lambda s: _bunched(s, 3, 0.0005, _ALL)),
    Member("G", "gap of 10,000 s", lambda s: _gap(s, 1e4)),
    Member("G", "clock set from 1970", lambda s: _gap(s, 1.7599e9)),
    Member("-", "jitter of 4 ms", _jittered),
)
