"""The persons of a calibration: tracks that show the same one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stcalib_ros.core import stba
from stcalib_ros.core.association import Association
from stcalib_ros.core.averaging import Rig
from stcalib_ros.core.lift import LiftedCamera
from stcalib_ros.core.rounds import Round
from stcalib_ros.core.types import PersonAssociation

_MIN_TRACK_SHARE = 0.25


def found_persons(
    cameras: Sequence[LiftedCamera], last: Round
) -> tuple[tuple[int, PersonAssociation], ...]:
    """Persons that at least two cameras see, numbered by how much is seen of them.

    Each with his number in the observations of the round.
    """
    o, association = last.observations, last.association
    errors = stba.errors_px(o, last.state)
    good = last.state.used & np.isfinite(errors)
    found = []
    for person in np.unique(o.person).tolist():
        rows = o.person == person
        tracks = tracks_of(cameras, last.rig, association, person)
        e = errors[rows][good[rows]]
        if len(tracks) >= 2 and len(e):
            rms = float(np.sqrt((e**2).mean()))
            margin = association.margins.get(person, float("inf"))
            found.append((len(e), person, tracks, rms, margin))
    found.sort(key=lambda f: -f[0])
    return tuple(
        (person, PersonAssociation(i, tracks, rms, margin))
        for i, (_, person, tracks, rms, margin) in enumerate(found)
    )


def tracks_of(
    cameras: Sequence[LiftedCamera], rig: Rig, association: Association, person: int
) -> dict[str, tuple[int, ...]]:
    """Tracks, by camera, that are this person for a good part of their time."""
    tracks = {}
    for i, c in enumerate(rig.cameras):
        slots = association.person_of[i]
        share = (slots == person).sum(1) / np.maximum((slots >= 0).sum(1), 1)
        if ids := tuple(
            cameras[c].tracks[p].track_id for p in np.flatnonzero(share >= _MIN_TRACK_SHARE)
        ):
            tracks[cameras[c].name] = ids
    return tracks
