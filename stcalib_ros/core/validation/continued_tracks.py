"""Persons of tracks that no longer fit: those that they had when they did.

A camera that is moved, or whose clock is set, loses the persons of the others; its own tracker goes
on. What such tracks show afterwards tells what has changed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stcalib_ros.core.integration.association import Association
from stcalib_ros.core.model.arrays import BoolArray, IntArray


def with_tracks_continued(association: Association) -> Association:
    """Give tracks that share their person with no other camera the one that they shared last.

    Or next, where that is nearer in time; none where another track of the camera has that person.

    Parameters
    ----------
    association : Association
    """
    shared = _shared(association)
    return replace(
        association,
        person_of=tuple(_continued(persons, shared) for persons in association.person_of),
    )


def _shared(association: Association) -> BoolArray:
    """Whether two cameras or more have a person in a slot: (slots, persons)."""
    n_slots = association.person_of[0].shape[1]
    count = np.zeros((n_slots, association.n_persons), dtype=np.int64)
    for persons in association.person_of:
        _, slot = np.nonzero(persons >= 0)
        has = np.zeros_like(count)
        has[slot, persons[persons >= 0]] = 1
        count += has
    return np.asarray(count > 1)


def _continued(persons: IntArray, shared: BoolArray) -> IntArray:
    """Persons (P, S) of the tracks of one camera, those of tracks that are alone replaced."""
    out: IntArray = persons.copy()
    for track, row in enumerate(persons):
        there = np.flatnonzero(row >= 0)
        fits = shared[there, row[there]]
        known = there[fits]
        if not len(known):
            continue
        for slot in there[~fits]:
            person = row[known[np.abs(known - slot).argmin()]]
            if not (out[:, slot] == person).any():
                out[track, slot] = person
    return out
