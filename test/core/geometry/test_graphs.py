"""Connected components and spanning trees of cameras."""

from __future__ import annotations

import numpy as np
import pytest

from stcalib_ros.core.geometry.graphs import components


def reachable(tied):
    """Groups by repeated squaring of the graph, as a slow second opinion."""
    near = tied | tied.T | np.eye(len(tied), dtype=bool)
    for _ in range(len(tied)):
        near = near @ near
    return {frozenset(np.flatnonzero(row).tolist()) for row in near}


@pytest.mark.parametrize("seed", range(10))
def test_components_are_what_can_be_reached(seed):
    rng = np.random.default_rng(seed)
    tied = np.triu(rng.uniform(size=(9, 9)) < 0.12, 1)
    found = components(tied)
    assert {frozenset(group) for group in found} == reachable(tied)
    assert sorted(found, key=lambda g: (-len(g), g)) == found


def test_no_nodes_are_no_components():
    assert components(np.zeros((0, 0), dtype=bool)) == []
