"""Persons of tracks that no longer fit: those that they had when they did.

A camera that is moved, or whose clock is set, loses the persons of the others; its own tracker goes
on. What such tracks show afterwards tells what has changed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stcalib_ros.core.integration.association import Association
from stcalib_ros.core.model.arrays import IntArray


def with_tracks_continued(association: Association) -> Association:
    """Give tracks that share their person with no other camera the one that they shared last.

    Or next, where that is nearer in time; none where another track of the camera has that person.

    Parameters
    ----------
    association : Association
    """
    shared, n = _shared(association), association.n_persons
    return replace(
        association,
        person_of=tuple(_continued(persons, shared, n) for persons in association.person_of),
    )


def _shared(association: Association) -> IntArray:
    """Persons in slots, as ``slot * n_persons + person``, that two cameras or more have."""
    keys = []
    for persons in association.person_of:
        track, slot = np.nonzero(persons >= 0)
        keys.append(np.unique(slot * association.n_persons + persons[track, slot]))
    every, count = np.unique(np.concatenate(keys), return_counts=True)
    return np.asarray(every[count > 1], dtype=np.int64)


def _continued(persons: IntArray, shared: IntArray, n_persons: int) -> IntArray:
    """Persons (P, S) of the tracks of one camera, those of tracks that are alone replaced."""
    out: IntArray = persons.copy()
    for track, row in enumerate(persons):
        there = np.flatnonzero(row >= 0)
        fits = np.isin(there * n_persons + row[there], shared)
        known = there[fits]
        if not len(known):
            continue
        for slot in there[~fits]:
            person = row[known[np.abs(known - slot).argmin()]]
            if not (out[:, slot] == person).any():
                out[track, slot] = person
    return out
