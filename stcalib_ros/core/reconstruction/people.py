"""The persons of a calibration: tracks that show the same one, and their joints over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.limits import NEAREST
from stcalib_ros.core.bundle.residuals import errors_px
from stcalib_ros.core.bundle.state import person_rows_of
from stcalib_ros.core.integration.association import Association
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.calibration import PersonAssociation
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.reconstruction.limits import MAX_PEOPLE, MIN_TRACK_FRACTION, WIDEST_VIEW
from stcalib_ros.core.reconstruction.same_people import same_people
from stcalib_ros.core.registration.resampling import GridTracks, tracks_on_grid


def found_persons(
    cameras: Sequence[LiftedCamera], last: Iteration
) -> tuple[tuple[tuple[int, ...], PersonAssociation], ...]:
    """Return the persons that at least two cameras observe, those with most inliers first.

    Each is preceded by its numbers in the observations of the iteration, more than one where
    somebody was split.
    """
    obs, association = last.observations, last.association
    errors = errors_px(obs, last.state)
    good = last.state.inlier & np.isfinite(errors)
    found = []
    for numbers in same_people(last):
        rows = np.isin(obs.person, numbers)
        tracks = tracks_of(cameras, last.rig, association, numbers)
        e = errors[rows][good[rows]]
        if len(tracks) >= 2 and len(e):
            rms = float(np.sqrt((e**2).mean()))
            margin = min(association.margins.get(one, float("inf")) for one in numbers)
            found.append((len(e), numbers, tracks, rms, margin))
    found.sort(key=lambda f: -f[0])
    return tuple(
        (numbers, PersonAssociation(i, tracks, rms, margin))
        for i, (_, numbers, tracks, rms, margin) in enumerate(found)
    )


def tracks_of(
    cameras: Sequence[LiftedCamera], rig: Rig, association: Association, numbers: Sequence[int]
) -> dict[str, tuple[int, ...]]:
    """Return the tracks, by camera, that show a person for a good part of their time."""
    tracks = {}
    for i, c in enumerate(rig.cameras):
        slots = association.person_of[i]
        fraction = np.isin(slots, numbers).sum(1) / np.maximum((slots >= 0).sum(1), 1)
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


def people_on_grid(skeleton: Skeleton, last: Iteration) -> tuple[GridTracks, list[int]]:
    """Return the people observed longest as tracks in the frame of the reference camera.

    Parameters
    ----------
    skeleton : Skeleton
    last : Iteration

    Returns
    -------
    GridTracks
        One sample per time bin.
    list of int
        Their numbers in the observations.
    """
    obs = last.observations
    n = int(obs.time_bin.max()) + 1
    paths, numbers = [], []
    for rows, joints in _longest_paths(last):
        first = int(obs.time_bin[rows.start])
        path = np.full((n, *joints.shape[1:]), np.nan)
        path[first : first + len(joints)] = joints
        paths.append(path)
        numbers.append(int(obs.person[rows.start]))
    grid = tracks_on_grid("people", paths, skeleton, start=obs.start_s, step=obs.step_s, n=n)
    return grid, numbers


def people_as_observed(last: Iteration, c: int) -> LiftedCamera:
    """Return the people observed longest as a camera of the rig would have them without errors.

    It has an image at every time bin, by the reference clock.

    Parameters
    ----------
    last : Iteration
    c : int
        Position of the camera in the rig.
    """
    obs, state = last.observations, last.state
    focal = float(np.median(obs.focal[:, c][obs.observed[:, c]]))
    tracks = []
    for number, (rows, joints) in enumerate(_longest_paths(last)):
        X = joints @ state.R_cam_ref[c].T + state.t_cam_ref[c]
        known = np.isfinite(X[..., 2])
        ahead = np.where(known, X[..., 2], -1.0) > NEAREST
        x = np.where(ahead[..., None], X[..., :2] / X[..., 2:], np.nan)
        x[(np.abs(x) > WIDEST_VIEW).any(-1)] = np.nan
        count = np.maximum(known.sum(1), 1)
        root = np.where(known[..., None], X, 0.0).sum(1) / count[:, None]
        frames = int(obs.time_bin[rows.start]) + np.arange(len(X))
        tracks.append(LiftedTrack(number, frames, x, np.full(x.shape[:2], focal), X, root))
    bins = np.arange(int(obs.time_bin.max()) + 1, dtype=np.float64)
    stamps: Float64Array = obs.start_s + obs.step_s * bins
    return LiftedCamera("people", stamps, tuple(tracks))


def _longest_paths(last: Iteration) -> list[tuple[slice, Float64Array]]:
    """Return rows and joints (K, J, 3) of the people who are observed longest."""
    parts = list(person_rows_of(last.observations))
    longest = sorted(range(len(parts)), key=lambda k: parts[k].start - parts[k].stop)[:MAX_PEOPLE]
    return [(parts[k], joints) for k, joints in enumerate(joint_paths(last)) if k in longest]


def joint_path(last: Iteration, rows: IntArray) -> Float64Array:
    """Return the joints (K, J, 3) of the rows of one person, uniform in time.

    The rows are in the order of time. Of two at one time, each joint is that of the one which more
    cameras see.
    """
    bins = last.observations.time_bin[rows] - last.observations.time_bin[rows[0]]
    views = last.state.inlier[rows].sum(1)
    known: BoolArray = views >= 2
    X = np.where(known[..., None], last.state.X[rows], np.nan)
    joints = np.full((int(bins[-1]) + 1, *X.shape[1:]), np.nan)
    most = np.zeros(joints.shape[:2], dtype=np.int64)
    for k, time_bin in enumerate(bins.tolist()):
        better = views[k] > most[time_bin]
        joints[time_bin][better], most[time_bin][better] = X[k][better], views[k][better]
    return joints
