"""Graphs of cameras: connected components and spanning trees."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse.csgraph import connected_components

from stcalib_ros.core.model.arrays import BoolArray, IntArray
from stcalib_ros.core.model.relative_pose import RelativePose


def connected_groups(cameras: Sequence[int], hypotheses: Sequence[RelativePose]) -> list[list[int]]:
    """Groups of cameras that are connected by hypotheses, the largest first."""
    position = {c: i for i, c in enumerate(cameras)}
    tied = np.zeros((len(cameras), len(cameras)), dtype=bool)
    for h in hypotheses:
        tied[position[h.a], position[h.b]] = True
    return [[cameras[i] for i in group] for group in components(tied)]


def components(tied: BoolArray) -> list[tuple[int, ...]]:
    """Connected components of an undirected graph, the largest first, then by their first node.

    Parameters
    ----------
    tied : (C, C) ndarray of bool
        Edges between nodes; one direction of each is enough.
    """
    _, label = connected_components(tied, directed=False)
    groups = [tuple(np.flatnonzero(label == k).tolist()) for k in range(label.max(initial=-1) + 1)]
    return sorted(groups, key=lambda group: (-len(group), group))


def spanning_tree(
    a: IntArray, b: IntArray, order: IntArray, n_nodes: int
) -> list[tuple[int, bool]]:
    """Spanning tree from node 0 (Prim): edges, and whether they lead from a to b.

    Parameters
    ----------
    a, b : (E,) ndarray of int
        Nodes that each edge connects; the graph is connected.
    order : (E,) ndarray of int
        Edges, the preferred ones first.
    n_nodes : int
        Number of nodes.
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
