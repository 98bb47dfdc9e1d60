"""The persons of a calibration: tracks that show the same one, and their joints over time."""

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
    """Return the persons that at least two cameras observe, those with most inliers first.

    Each is preceded by its number in the observations of the iteration.
    """
    obs, association = last.observations, last.association
    errors = errors_px(obs, last.state)
    good = last.state.inlier & np.isfinite(errors)
    found = []
    for person in np.unique(obs.person).tolist():
        rows = obs.person == person
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
    """Return the tracks, by camera, that show this person for a good part of their time."""
    tracks = {}
    for i, c in enumerate(rig.cameras):
        slots = association.person_of[i]
        fraction = (slots == person).sum(1) / np.maximum((slots >= 0).sum(1), 1)
        if ids := tuple(
            cameras[c].tracks[p].track_id for p in np.flatnonzero(fraction >= MIN_TRACK_FRACTION)
        ):
            tracks[cameras[c].name] = ids
    return tracks


def joint_paths(last: Iteration) -> Iterator[Float64Array]:
    """Yield the joints (K, J, 3) of every person of an iteration at uniform times.

    They are in the frame of the reference camera and the unit of the adjustment; NaN where fewer
    than two cameras have an inlier.
    """
    for part in person_rows_of(last.observations):
        yield joint_path(last, np.arange(part.start, part.stop))


def people_on_grid(
    skeleton: Skeleton, last: Iteration, *, start: float | None = None, n: int | None = None
) -> tuple[GridTracks, list[int]]:
    """Return the people observed longest as tracks in the frame of the reference camera.

    Parameters
    ----------
    skeleton : Skeleton
    last : Iteration
    start : float, optional
        Time of the first sample, not after the first time bin (the default).
    n : int, optional
        Number of samples, one per time bin; by default up to the last bin.

    Returns
    -------
    GridTracks
    list of int
        Their numbers in the observations.
    """
    obs = last.observations
    start = obs.start_s if start is None else start
    before = round((obs.start_s - start) / obs.step_s)
    n = before + int(obs.time_bin.max()) + 1 if n is None else n
    parts = list(person_rows_of(obs))
    longest = sorted(range(len(parts)), key=lambda k: parts[k].start - parts[k].stop)
    kept = longest[:MAX_PEOPLE]
    paths, numbers = [], []
    for k, joints in enumerate(joint_paths(last)):
        if k in kept:
            first = before + int(obs.time_bin[parts[k].start])
            path = np.full((n, *joints.shape[1:]), np.nan)
            path[first : first + len(joints)] = joints
            paths.append(path)
            numbers.append(int(obs.person[parts[k].start]))
    return tracks_on_grid("people", paths, skeleton, start=start, step=obs.step_s, n=n), numbers


def joint_path(last: Iteration, rows: IntArray) -> Float64Array:
    """Return the joints (K, J, 3) of the rows of one person, uniform in time."""
    bins = last.observations.time_bin[rows] - last.observations.time_bin[rows[0]]
    known: BoolArray = last.state.inlier[rows].sum(1) >= 2
    joints = np.full((int(bins[-1]) + 1, *last.state.X.shape[1:]), np.nan)
    joints[bins] = np.where(known[..., None], last.state.X[rows], np.nan)
    return joints
