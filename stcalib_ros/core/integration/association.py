"""Person association across views, once poses and clocks are known roughly.

Tracks are cut into slots of time, since a camera's tracker may exchange two people. In each
slot the pieces of all cameras are agglomerated by their epipolar distance and by where the
monocular poses stand, never two of one camera at one time; then the groups of successive
slots are chained by their common tracks, so that an exchange in one camera is
outvoted by the others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from stcalib_ros.core.geometry.epipolar import sampson
from stcalib_ros.core.geometry.interpolation import (
    LONGEST_BRIDGE_S,
    Interpolation,
    bridged,
    frame_period,
)
from stcalib_ros.core.geometry.robust import median_of_known
from stcalib_ros.core.geometry.so3 import hat
from stcalib_ros.core.integration.limits import (
    BODY_WEIGHT,
    FEW_SAMPLES_COST,
    MAX_COST,
    MAX_DEPTH_ERROR,
    MERGE_COST,
    MIN_SHARED_KEYPOINTS,
    TOLERANCE_FACTOR,
    USUAL_BODY_DISTANCE,
)
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, FloatArray, IntArray
from stcalib_ros.core.model.lifted import LiftedCamera, time_span
from stcalib_ros.core.model.rig import Rig

SLOT_SAMPLES = 50
"""Samples of the grid in a slot of time (1.7 s at 30 Hz), within which ids count as right. Chosen
on simulated scenes of benchmarks.accuracy.level; not verified on real recordings."""
_SAMPLES_PER_SLOT = 8
"""Samples at which pieces are compared in a slot. Numerical: bounds the cost."""


@dataclass(frozen=True, slots=True, eq=False)
class Association:
    """Persons of all tracks, slot by slot.

    Attributes
    ----------
    person_of : tuple of (P, S) ndarray of int
        For each camera of the rig: person of track p in slot s, -1 where none.
    start_s, slot_s : float
        Begin of slot 0 by the reference clock and length of a slot, seconds.
    n_persons : int
    typical_px : float
        Median epipolar distance of mutually nearest pieces; a third of the floor where it is
        less.
    margins : mapping of int to float
        Per person, epipolar distance of the next best assignment over that of this one; inf
        where nobody else could be confused with them.
    """

    person_of: tuple[IntArray, ...]
    start_s: float
    slot_s: float
    n_persons: int
    typical_px: float
    margins: Mapping[int, float]

    def slot(self, times: Float64Array) -> IntArray:
        """Slots of times of the reference clock."""
        n = self.person_of[0].shape[1]
        index = np.floor((times - self.start_s) / self.slot_s).astype(np.int64)
        return np.clip(index, 0, n - 1)


@dataclass(frozen=True, slots=True, eq=False)
class _Pieces:
    """Tracks of one camera in one slot, those that are seen in it; bodies in the rig's frame.

    However many tracks there are in a recording, few are in a slot.
    """

    track: IntArray  # (n,)
    x: Float64Array  # (n, K, J, 3)
    focal: Float64Array  # (n, K, J)
    body: Float64Array  # (n, K, 3)
    depth: Float64Array  # (n, K)
    present: BoolArray  # (n, K)


def associate(
    cameras: Sequence[LiftedCamera], rig: Rig, *, step_s: float, floor_px: float, every: int = 1
) -> Association:
    """Group the tracks of all cameras of a rig into persons.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras; those of the rig are used.
    rig : Rig
    step_s : float
        Grid step, seconds; a slot has 50 of them.
    floor_px : float
        Pieces up to this median epipolar distance belong together at least; the tolerance is
        wider where even the best pairs do not come that close.
    every : int
        Look at every n-th slot only; in the others, nobody is associated.
    """
    members = [cameras[c] for c in rig.cameras]
    slot_s = SLOT_SAMPLES * step_s
    start, end = time_span(members, rig.offset_s)
    n_slots = max(1, int(np.ceil((end + 1e-6 - start) / slot_s)))
    fractions = (np.arange(_SAMPLES_PER_SLOT) + 0.5) / _SAMPLES_PER_SLOT
    slots = np.arange(0, n_slots, every)
    times = start + slot_s * (slots[:, None] + fractions)
    samples = [_sample(camera, rig, i, times) for i, camera in enumerate(members)]
    in_slot = list(zip(*samples, strict=True))
    distance = [_distances(pieces, rig) for pieces in in_slot]
    tolerance = _tolerance(distance, floor_px)
    chain = Chain([len(m.tracks) for m in members], len(slots))
    for s, (pieces, of_pair) in enumerate(zip(in_slot, distance, strict=True)):
        chain.add(s, _agglomerate(pieces, of_pair, tolerance))
    typical = tolerance / TOLERANCE_FACTOR
    margins = _margins(chain, in_slot, distance)
    person_of = tuple(_in_slots(known, slots, n_slots) for known in chain.person_of)
    return Association(person_of, start, slot_s, chain.n_persons, typical, margins)


def _in_slots(known: IntArray, slots: IntArray, n_slots: int) -> IntArray:
    """Persons in all slots (P, n_slots), from those in some of them."""
    person_of: IntArray = np.full((len(known), n_slots), -1, dtype=np.int64)
    person_of[:, slots] = known
    return person_of


def _sample(camera: LiftedCamera, rig: Rig, i: int, times: Float64Array) -> list[_Pieces]:
    """Return the pieces of a camera in every slot, at times (S, K) of the reference clock."""
    local = times - rig.offset_s[i]
    period = frame_period(camera.stamps)
    parts: list[list[tuple[int, FloatArray, FloatArray, FloatArray]]] = [[] for _ in times]
    for p, track in enumerate(camera.tracks):
        stamps = camera.stamps[track.frames]
        first = int(np.searchsorted(local[:, -1], stamps[0] - period))
        end = int(np.searchsorted(local[:, 0], stamps[-1] + period))
        if end <= first:
            continue
        at = Interpolation(stamps, local[first:end].ravel(), period=period)
        shape = (end - first, times.shape[1])
        seen = bridged(track.x, stamps, longest_s=LONGEST_BRIDGE_S)
        focals = bridged(track.focal[..., None], stamps, longest_s=LONGEST_BRIDGE_S)
        x = at(seen).reshape(*shape, -1, 2)
        focal = at(focals[..., 0]).reshape(*shape, -1)
        root = at(track.root_cam).reshape(*shape, 3)
        for k in np.flatnonzero(np.isfinite(x[..., 0]).any((1, 2))).tolist():
            parts[first + k].append((p, x[k], focal[k], root[k]))
    J = camera.tracks[0].x.shape[1] if camera.tracks else 0
    return [_pieces(part, (times.shape[1], J), rig, i) for part in parts]


def _pieces(
    parts: Sequence[tuple[int, FloatArray, FloatArray, FloatArray]],
    shape: tuple[int, int],
    rig: Rig,
    i: int,
) -> _Pieces:
    """Return pieces (track, keypoints, focal lengths, bodies) of one slot together."""
    n, (K, J) = len(parts), shape
    x, focal, root = np.ones((n, K, J, 3)), np.empty((n, K, J)), np.empty((n, K, 3))
    for k, (_, points, focals, bodies) in enumerate(parts):
        x[k, ..., :2], focal[k], root[k] = points, focals, bodies
    known = np.isfinite(x[..., 0])
    x[..., 2] = np.where(known, 1.0, np.nan)
    body = (root.reshape(-1, 3) @ rig.R_ref_cam[i].T + rig.t_ref_cam[i]).reshape(n, K, 3)
    track = np.array([part[0] for part in parts], dtype=np.int64)
    present: BoolArray = np.asarray(known.any(-1))
    return _Pieces(track, x, focal, body, root[..., 2], present)


@dataclass(frozen=True, slots=True, eq=False)
class _Distance:
    """Epipolar distance (px) and distance of the bodies of all pieces of two cameras in a slot.

    The latter over the largest at which they may be one; zero where it is not known. Also the
    number of samples in which both are seen.
    """

    epipolar: Float64Array  # (n, m)
    body: Float64Array  # (n, m)
    n_shared: IntArray  # (n, m)


_Distances = dict[tuple[int, int], _Distance]
"""By pair of cameras."""


def _distances(pieces: Sequence[_Pieces], rig: Rig) -> _Distances:
    C = len(pieces)
    return {
        (a, b): _distance(pieces[a], pieces[b], *_relative(rig, a, b))
        for a in range(C)
        for b in range(a + 1, C)
        if len(pieces[a].track) and len(pieces[b].track)
    }


def _relative(rig: Rig, a: int, b: int) -> tuple[Float64Array, Float64Array]:
    R_a = rig.R_ref_cam[a]
    return R_a.T @ rig.R_ref_cam[b], R_a.T @ (rig.t_ref_cam[b] - rig.t_ref_cam[a])


def _distance(a: _Pieces, b: _Pieces, R_a_b: Float64Array, t_a_b: Float64Array) -> _Distance:
    E = hat(t_a_b / max(float(np.linalg.norm(t_a_b)), 1e-9)) @ R_a_b
    n, m = len(a.track), len(b.track)
    epipolar, body = np.empty((n, m)), np.empty((n, m))
    x_b, focal_b = b.x.reshape(m, -1, 3), b.focal.reshape(m, -1)
    for i in range(n):
        focal = np.sqrt(a.focal[i].ravel() * focal_b)
        errors = np.abs(sampson(E, a.x[i].reshape(1, -1, 3), x_b)) * focal
        epipolar[i] = median_of_known(errors, least=MIN_SHARED_KEYPOINTS)
        gap = np.linalg.norm(a.body[i] - b.body, axis=-1)
        reach = MAX_DEPTH_ERROR * (a.depth[i] + b.depth)
        body[i] = median_of_known(gap / reach, otherwise=0.0)
    n_shared = a.present.astype(np.int64) @ b.present.T.astype(np.int64)
    return _Distance(epipolar, body, n_shared)


def _tolerance(distance: Sequence[_Distances], floor_px: float) -> float:
    """Three times the usual distance of mutually nearest pieces, but at least the floor."""
    nearest = []
    for d in (d for of_pair in distance for d in of_pair.values()):
        gated = np.where(d.body < USUAL_BODY_DISTANCE, d.epipolar, np.inf)
        mutual = (gated <= gated.min(0, keepdims=True)) & (gated <= gated.min(1, keepdims=True))
        nearest.append(gated[mutual & np.isfinite(gated)])
    values = np.concatenate(nearest) if nearest else np.zeros(0)
    typical = float(np.median(values)) if len(values) else 0.0
    return max(floor_px, TOLERANCE_FACTOR * typical)


def _margins(
    chain: Chain, in_slot: Sequence[Sequence[_Pieces]], distance: Sequence[_Distances]
) -> dict[int, float]:
    """Median distance to the nearest other person over the median distance within persons."""
    own: dict[int, list[float]] = {}
    other: dict[int, list[float]] = {}
    for s, (pieces, of_pair) in enumerate(zip(in_slot, distance, strict=True)):
        person = [of[one.track, s] for of, one in zip(chain.person_of, pieces, strict=True)]
        for (a, b), d in of_pair.items():
            here, there = person[a][:, None], person[b][None]
            known = (here >= 0) & (there >= 0)
            same = known & (here == there)
            rival = np.where(known & ~same, d.epipolar, np.inf).min(1)
            for i, j in np.argwhere(same).tolist():
                own.setdefault(int(here[i, 0]), []).append(float(d.epipolar[i, j]))
            for i in np.flatnonzero(same.any(1)).tolist():
                other.setdefault(int(here[i, 0]), []).append(float(rival[i]))
    return {
        p: float(np.median(other[p])) / max(float(np.median(own[p])), 1e-6) for p in sorted(own)
    }


def _agglomerate(
    in_slot: Sequence[_Pieces], distance: _Distances, tolerance: float
) -> list[list[tuple[int, int]]]:
    """Average-link clusters of the pieces (camera, track) of one slot."""
    pieces = [(c, p) for c, one in enumerate(in_slot) for p in range(len(one.track))]
    n = len(pieces)
    cost, known, shared = np.zeros((3, n, n))
    exclusive = np.eye(n, dtype=bool)
    for i, (a, p) in enumerate(pieces):
        for j in range(i + 1, n):
            b, q = pieces[j]
            if a == b:
                together = in_slot[a].present[p] & in_slot[a].present[q]
                exclusive[i, j] = exclusive[j, i] = together.any()
                continue
            d = distance[a, b]
            value = d.epipolar[p, q] / tolerance + BODY_WEIGHT * d.body[p, q] ** 2
            if np.isfinite(value):
                cost[i, j] = cost[j, i] = min(float(value), MAX_COST)
                known[i, j] = known[j, i] = 1.0
                shared[i, j] = shared[j, i] = d.n_shared[p, q]
    groups = _average_link(cost, known, shared, exclusive)
    return [[(c, int(in_slot[c].track[p])) for c, p in (pieces[i] for i in g)] for g in groups]


def _average_link(
    cost: Float64Array, known: Float64Array, shared: Float64Array, exclusive: BoolArray
) -> list[list[int]]:
    """Merge the closest groups while their mean cost is below one and nothing forbids it.

    Of groups about equally close, those that are seen together in more samples come first: where
    there is one, strangers may look as close by chance.
    """
    cost, known, shared = cost.copy(), known.copy(), shared.copy()
    exclusive = exclusive.copy()
    groups = [[i] for i in range(len(cost))]
    while len(groups) > 1:
        mean = cost / np.maximum(known, 1.0)
        possible = (known > 0) & ~exclusive & (mean < MERGE_COST)
        if not possible.any():
            break
        order = np.where(possible, mean + FEW_SAMPLES_COST / np.maximum(shared, 1.0), np.inf)
        i, j = sorted(np.unravel_index(int(order.argmin()), order.shape))
        groups[i] += groups.pop(j)
        for matrix in (cost, known, shared):
            matrix[i] += matrix[j]
            matrix[:, i] += matrix[:, j]
        exclusive[i] |= exclusive[j]
        exclusive[:, i] |= exclusive[:, j]
        exclusive[i, i] = True
        keep = np.arange(len(cost)) != j
        rest = np.ix_(keep, keep)
        cost, known, shared, exclusive = cost[rest], known[rest], shared[rest], exclusive[rest]
    return groups


class Chain:
    """Persons through time: groups of successive slots with common tracks are one person."""

    def __init__(self, n_tracks: Sequence[int], n_slots: int) -> None:
        self.person_of = [np.full((n, n_slots), -1, dtype=np.int64) for n in n_tracks]
        self.last: list[IntArray] = [np.full(n, -1, dtype=np.int64) for n in n_tracks]
        self.n_persons = 0

    def add(self, s: int, groups: list[list[tuple[int, int]]]) -> None:
        """Give every group of slot `s` the person that most of its tracks had last."""
        votes = np.zeros((len(groups), self.n_persons))
        for g, group in enumerate(groups):
            for c, p in group:
                if (person := self.last[c][p]) >= 0:
                    votes[g, person] += 1.0
        rows, columns = linear_sum_assignment(votes, maximize=True)
        person_of_group = {
            int(g): int(best) for g, best in zip(rows, columns, strict=True) if votes[g, best] > 0
        }
        for g, group in enumerate(groups):
            if g not in person_of_group:
                person_of_group[g] = self.n_persons
                self.n_persons += 1
            for c, p in group:
                self.person_of[c][p, s] = self.last[c][p] = person_of_group[g]
