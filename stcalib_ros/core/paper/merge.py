"""Association of all cameras from those of the pairs, along a spanning tree (Section IV).

Two cameras are connected by one path of the tree only, so that following the matches from camera to
camera gives every track one person at most: cycles are consistent by construction.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from stcalib_ros.core.geometry.graphs import spanning_tree
from stcalib_ros.core.integration.association import Association, Chain
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.lifted import LiftedCamera, time_span
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.paper.registration import PairRegistration

_Edge = tuple[int, int, Float64Array]
"""Camera, camera (positions in the rig), votes (S, P, Q) of their tracks in every slot."""


def merge(
    cameras: Sequence[LiftedCamera],
    rig: Rig,
    pairs: Sequence[PairRegistration],
    *,
    start_s: float,
    step_s: float,
    window: int,
) -> Association:
    """Associate the persons of all cameras, slot by slot; a slot lasts from one window to the next.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras, of which those of the rig are used.
    rig : Rig
    pairs : sequence of PairRegistration
        Pairs of cameras of the rig, on the same windows.
    start_s, step_s : float
        Time of sample 0 and between samples of the grid of the windows, seconds.
    window : int
        Number of samples of a window.
    """
    node = {int(c): i for i, c in enumerate(rig.cameras)}
    starts = pairs[0].starts
    slot_s = step_s * (float(np.diff(starts).mean()) if len(starts) > 1 else float(window))
    begin, end = time_span([cameras[c] for c in rig.cameras], rig.offset_s)
    middle = start_s + step_s * (float(starts[0]) + window / 2)
    first_s = middle - slot_s * np.ceil((middle - begin) / slot_s - 0.5) - slot_s / 2
    n_slots = int(np.ceil((end - first_s) / slot_s)) + 1
    n_tracks = [len(cameras[c].tracks) for c in rig.cameras]
    a = np.array([node[p.hypothesis.a] for p in pairs])
    b = np.array([node[p.hypothesis.b] for p in pairs])
    order = np.argsort([-p.hypothesis.support for p in pairs], kind="stable")
    edges: list[_Edge] = []
    for e, _ in spanning_tree(a, b, order, len(rig.cameras)):
        votes = np.zeros((n_slots, n_tracks[a[e]], n_tracks[b[e]]))
        w, p, q = pairs[e].matches.T
        samples = starts[w, None] + np.arange(window)
        times = start_s + step_s * samples + rig.offset_s[a[e]]
        slot = np.clip(np.floor((times - first_s) / slot_s).astype(np.int64), 0, n_slots - 1)
        np.add.at(votes, (slot, p[:, None], q[:, None]), 1.0)
        edges.append((int(a[e]), int(b[e]), votes))
    chain = Chain(n_tracks, n_slots)
    for s in range(n_slots):
        chain.add(s, _groups(edges, s))
    return Association(
        person_of=tuple(chain.person_of),
        start_s=float(first_s),
        slot_s=slot_s,
        n_persons=chain.n_persons,
        typical_px=float("nan"),
        margins={},
    )


def _groups(edges: Sequence[_Edge], s: int) -> list[list[tuple[int, int]]]:
    """Group the tracks (camera, track) that are one person in slot s."""
    group: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for a, b, votes in edges:
        for p, q in _one_to_one(votes[s]):
            here, there = group.get((a, p), [(a, p)]), group.get((b, q), [(b, q)])
            both = here + there
            group |= dict.fromkeys(both, both)
    return [list(g) for g in dict.fromkeys(tuple(g) for g in group.values())]


def _one_to_one(votes: Float64Array) -> list[tuple[int, int]]:
    rows, columns = linear_sum_assignment(votes, maximize=True)
    kept: IntArray = np.flatnonzero(votes[rows, columns] > 0)
    return [(int(rows[k]), int(columns[k])) for k in kept]
