"""Graphs of cameras: connected components and spanning trees."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stcalib_ros.core.model.arrays import IntArray
from stcalib_ros.core.model.relative_pose import RelativePose


def connected_groups(cameras: Sequence[int], hypotheses: Sequence[RelativePose]) -> list[list[int]]:
    """Cameras that hang together through at least one hypothesis, largest group first."""
    group = {c: c for c in cameras}
    for h in hypotheses:
        old, new = group[h.b], group[h.a]
        group = {c: new if g == old else g for c, g in group.items()}
    members = [[c for c in cameras if group[c] == g] for g in dict.fromkeys(group.values())]
    return sorted(members, key=len, reverse=True)


def spanning_tree(
    a: IntArray, b: IntArray, order: IntArray, n_nodes: int
) -> list[tuple[int, bool]]:
    """Prim's algorithm from node 0: edges, and whether they lead from a to b.

    Parameters
    ----------
    a, b : (E,) ndarray of int
        Nodes that each edge ties; all of them hang together.
    order : (E,) ndarray of int
        Edges, the most wanted first.
    n_nodes : int
    """
    reached = np.zeros(n_nodes, dtype=bool)
    reached[0] = True
    edges = []
    while not reached.all():
        leads_out = np.flatnonzero(reached[a[order]] != reached[b[order]])
        e = int(order[leads_out[0]])
        edges.append((e, bool(reached[a[e]])))
        reached[a[e]] = reached[b[e]] = True
    return edges
