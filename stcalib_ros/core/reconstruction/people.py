"""The persons of a calibration: tracks that show the same one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.residuals import errors_px
from stcalib_ros.core.bundle.state import person_rows_of
from stcalib_ros.core.integration.association import Association
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.calibration import PersonAssociation
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.reconstruction.limits import MAX_PEOPLE, MIN_TRACK_FRACTION
from stcalib_ros.core.registration.resampling import GridTracks, tracks_on_grid


def found_persons(
    cameras: Sequence[LiftedCamera], last: Iteration
) -> tuple[tuple[int, PersonAssociation], ...]:
    """Persons that at least two cameras see, numbered by how much is seen of them.

    Each with his number in the observations of the round.
    """
    o, association = last.observations, last.association
    errors = errors_px(o, last.state)
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
            cameras[c].tracks[p].track_id for p in np.flatnonzero(share >= MIN_TRACK_FRACTION)
        ):
            tracks[cameras[c].name] = ids
    return tracks


def joint_paths(last: Iteration) -> Iterator[Float64Array]:
    """Joints (K, J, 3) of every person of a round at uniform times, one person after the other.

    In the frame of the reference camera and the unit of the adjustment; NaN where fewer than two
    cameras have image points that fit.
    """
    o = last.observations
    for part in person_rows_of(o):
        yield _path(last, np.arange(part.start, part.stop))


def people_on_grid(
    skeleton: Skeleton, last: Iteration, *, start: float | None = None, n: int | None = None
) -> tuple[GridTracks, list[int]]:
    """The people, those that are seen longest, as tracks in the frame of the reference camera.

    Parameters
    ----------
    skeleton : Skeleton
    last : Iteration
    start : float, optional
        Time of the first sample, not after that of the first knot (the default).
    n : int, optional
        Samples, at the step of the knots; by default enough.

    Returns
    -------
    GridTracks
    list of int
        Their numbers in the observations.
    """
    o = last.observations
    start = o.start_s if start is None else start
    before = round((o.start_s - start) / o.step_s)
    n = before + int(o.knot.max()) + 1 if n is None else n
    parts = list(person_rows_of(o))
    longest = sorted(range(len(parts)), key=lambda k: parts[k].start - parts[k].stop)
    kept = longest[:MAX_PEOPLE]
    paths, numbers = [], []
    for k, joints in enumerate(joint_paths(last)):
        if k in kept:
            first = before + int(o.knot[parts[k].start])
            path = np.full((n, *joints.shape[1:]), np.nan)
            path[first : first + len(joints)] = joints
            paths.append(path)
            numbers.append(int(o.person[parts[k].start]))
    return tracks_on_grid("people", paths, skeleton, start=start, step=o.step_s, n=n), numbers


def _path(last: Iteration, rows: IntArray) -> Float64Array:
    """Joints (K, J, 3) of the rows of one person, from his first knot to his last."""
    knots = last.observations.knot[rows] - last.observations.knot[rows[0]]
    known: BoolArray = last.state.used[rows].sum(1) >= 2
    joints = np.full((int(knots[-1]) + 1, *last.state.X.shape[1:]), np.nan)
    joints[knots] = np.where(known[..., None], last.state.X[rows], np.nan)
    return joints
