"""A camera that was left out, registered once more: against the people that the others see.

Their joints are known in space and time by then. The camera's own 3D poses only have to say about
how it is turned and when; from there on its image points are fitted to the joints (resection, or
PnP, with the clock offset as a seventh unknown), and they say who is who.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.normal_equations import NEAREST
from stcalib_ros.core.geometry.so3 import exp_so3, hat, rotation_angle
from stcalib_ros.core.integration.association import SLOT_SAMPLES
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.model.rig import Rig, sub_rig
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.options import Options
from stcalib_ros.core.reconstruction.limits import (
    LOOSE_VOTE_THRESHOLD,
    MAX_SHIFT_FRAMES,
    MAX_TURN,
    MIN_EXPLAINED,
    MIN_GAIN,
    OTHER_OFFSET_FRAMES,
    OTHER_POSITION,
    OTHER_ROTATION,
    PERSON_SCALE_PX,
    RESECTION_SCALE_PX,
    RIVAL_RATIO,
)
from stcalib_ros.core.reconstruction.people import people_on_grid
from stcalib_ros.core.registration.resampling import sample_camera
from stcalib_ros.core.registration.voting import register_pair

_MAX_IMAGES = 300
"""Poses of the camera that are compared, at most. Numerical: bounds the cost."""
_STEPS = 15
"""Gauss-Newton steps, at most. Numerical: bounds the cost."""
_LEAST_STEPS = 5
"""Steps before convergence is looked at: persons change in the first ones. Numerical."""


@dataclass(frozen=True, slots=True, eq=False)
class Resection:
    """Where a camera stands among the people, and when.

    Attributes
    ----------
    R_ref_cam : (3, 3) ndarray
    t_ref_cam : (3,) ndarray
        In the frame and unit of the rig.
    offset_s : float
    explained : float
        Share of its image points that fit, each counted by how well.
    """

    R_ref_cam: Float64Array
    t_ref_cam: Float64Array
    offset_s: float
    explained: float

    def differs(self, other: Resection, frame_s: float) -> bool:
        """Whether the two are no one solution."""
        turned = float(rotation_angle(self.R_ref_cam.T @ other.R_ref_cam))
        moved = float(np.linalg.norm(self.t_ref_cam - other.t_ref_cam))
        shifted = abs(self.offset_s - other.offset_s) / frame_s
        return turned > OTHER_ROTATION or moved > OTHER_POSITION or shifted > OTHER_OFFSET_FRAMES


def resect(
    cameras: Sequence[LiftedCamera], index: int, skeleton: Skeleton, last: Iteration, o: Options
) -> Resection | None:
    """Find pose and clock of a camera that is not in the rig of a round.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    index : int
        Of the one to be registered.
    skeleton : Skeleton
    last : Iteration
        Of the other cameras.
    o : Options

    Returns
    -------
    Resection or None
        None where nothing fits, or another solution fits about as well.
    """
    frame_s = last.observations.step_s
    images = _Images(cameras[index], last, synchronised=o.synchronised)
    start = (
        images.fitted(Resection(h.R_a_b, h.t_a_b, -h.lag_s, 0.0))
        for h in _hypotheses(cameras[index], skeleton, last, o)
    )
    found = sorted(start, key=lambda one: -one.explained)
    if not found or found[0].explained < MIN_EXPLAINED:
        return None
    best, *others = found
    rivals = (other for other in others if other.differs(best, frame_s))
    if any(other.explained > RIVAL_RATIO * best.explained for other in rivals):
        return None
    return best


def add_cameras(rig: Rig, found: dict[int, Resection], order: Sequence[int]) -> Rig:
    """The rig with more cameras; the first of the order that it has becomes the reference."""
    grown = replace(
        rig,
        cameras=np.concatenate([rig.cameras, np.array(list(found), dtype=np.int64)]),
        R_ref_cam=np.concatenate([rig.R_ref_cam, [f.R_ref_cam for f in found.values()]]),
        t_ref_cam=np.concatenate([rig.t_ref_cam, [f.t_ref_cam for f in found.values()]]),
        offset_s=np.concatenate([rig.offset_s, [f.offset_s for f in found.values()]]),
    )
    place = {int(c): i for i, c in enumerate(grown.cameras)}
    return sub_rig(grown, [place[c] for c in order if c in place])


def _hypotheses(
    camera: LiftedCamera, skeleton: Skeleton, last: Iteration, o: Options
) -> tuple[RelativePose, ...]:
    """Candidates by bone directions: the people are one camera that sees everything exactly."""
    step = last.observations.step_s
    first = last.observations.start_s
    longest = max(float(last.observations.knot.max() * step), float(np.ptp(camera.stamps)))
    start = min(first, float(camera.stamps[0]))
    end = max(first, float(camera.stamps[0])) + longest
    n = int((end - start) / step) + 2
    people, _ = people_on_grid(skeleton, last, start=start, n=n)
    seen = sample_camera(camera, skeleton, start=start, step=step, n=n)
    max_lag = int(np.ceil(2.0 * o.offset_range_s / step))
    close = register_pair(0, 1, people, seen, max_lag, o.registration)
    loose = register_pair(
        0, 1, people, seen, max_lag, o.registration, thresholds=(LOOSE_VOTE_THRESHOLD,)
    )
    return (*close, *loose)


class _Predicted(NamedTuple):
    """Image points of every person in some images: residuals, and what they are made of."""

    r: Float64Array  # (P, M, J, 2), px
    Y: Float64Array  # (P, M, J, 3), in the camera
    V: Float64Array  # (P, M, J, 3), velocity, in the camera


class _Images:
    """Image points of one camera, thinned, and the people to be found in them."""

    def __init__(self, camera: LiftedCamera, last: Iteration, *, synchronised: bool) -> None:
        self.last, self.synchronised = last, synchronised
        total = sum(len(track.frames) for track in camera.tracks)
        every = max(1, total // _MAX_IMAGES)
        parts = [(t, q, slice(None, None, every)) for q, t in enumerate(camera.tracks)]
        self.times: Float64Array = np.concatenate([camera.stamps[t.frames[s]] for t, _, s in parts])
        self.x: Float64Array = np.concatenate([t.x[s] for t, _, s in parts]).astype(np.float64)
        self.focal: Float64Array = np.concatenate([t.focal[s] for t, _, s in parts])
        self.track: IntArray = np.concatenate(
            [np.full(len(t.frames[s]), q, dtype=np.int64) for t, q, s in parts]
        )
        self.n_points = max(int(np.isfinite(self.x[..., 0]).sum()), 1)
        self.row_of = _row_table(last)

    def fitted(self, start: Resection) -> Resection:
        """Gauss-Newton on the robust image error; persons are chosen again in every step."""
        best, at = start, start
        for step in range(_STEPS):
            predicted = self._predicted(at)
            error = np.linalg.norm(predicted.r, axis=-1)
            chosen = self._persons(error, at)
            mine = error[chosen, np.arange(len(chosen))]
            known = np.isfinite(mine) & (chosen >= 0)[:, None]
            if not known.any():
                return best
            weight = np.where(known, 1.0 / (1.0 + (mine / RESECTION_SCALE_PX) ** 2), 0.0)
            at = replace(at, explained=float(weight.sum()) / self.n_points)
            if step > _LEAST_STEPS and at.explained < best.explained + MIN_GAIN:
                return max(best, at, key=lambda one: one.explained)
            best = max(best, at, key=lambda one: one.explained)
            scale = max(RESECTION_SCALE_PX, float(np.median(mine[known])))
            at = self._step(at, predicted, chosen, known, scale)
        return best

    def _predicted(self, at: Resection) -> _Predicted:
        o, state = self.last.observations, self.last.state
        since = self.times + at.offset_s - o.start_s
        knot = np.rint(since / o.step_s).astype(np.int64)
        inside = (knot >= 0) & (knot < self.row_of.shape[1])
        row = np.where(inside, self.row_of[:, np.where(inside, knot, 0)], -1)
        when = (since - knot * o.step_s)[:, None, None]
        V = state.V[row] + when * state.A[row]
        X = state.X[row] + when * (state.V[row] + 0.5 * when * state.A[row])
        known = (state.used[row].sum(2) >= 2) & (row >= 0)[..., None]
        Y = (np.where(known[..., None], X, np.nan) - at.t_ref_cam) @ at.R_ref_cam
        Y[Y[..., 2] < NEAREST] = np.nan
        r = (Y[..., :2] / Y[..., 2:] - self.x) * self.focal[..., None]
        return _Predicted(r, Y, V @ at.R_ref_cam)

    def _persons(self, error: Float64Array, at: Resection) -> IntArray:
        """Person (M,) of every image of a track, one for a slot of time; -1 where none fits."""
        slot_s = SLOT_SAMPLES * self.last.observations.step_s
        slot = np.floor((self.times + at.offset_s) / slot_s).astype(np.int64)
        fits = np.nan_to_num(1.0 / (1.0 + (error / (PERSON_SCALE_PX)) ** 2)).sum(-1)
        chosen: IntArray = np.full(len(self.times), -1, dtype=np.int64)
        for s in np.unique(slot):
            rows = np.flatnonzero(slot == s)
            tracks, which = np.unique(self.track[rows], return_inverse=True)
            gain = np.zeros((len(tracks), len(fits)))
            for p, fit in enumerate(fits[:, rows]):
                gain[:, p] = np.bincount(which.ravel(), fit, len(tracks))
            person = np.full(len(tracks), -1)
            here, there = linear_sum_assignment(gain, maximize=True)
            person[here] = np.where(gain[here, there] > 0, there, -1)
            chosen[rows] = person[which.ravel()]
        return chosen

    def _step(
        self,
        at: Resection,
        predicted: _Predicted,
        chosen: IntArray,
        known: BoolArray,
        scale: float,
    ) -> Resection:
        """One step of the pose and the offset."""
        m, j = np.nonzero(known)
        r, Y, V = (one[chosen[m], m, j] for one in predicted)
        depth = Y[:, 2]
        J_Y = np.zeros((len(r), 2, 3))
        J_Y[:, 0, 0] = J_Y[:, 1, 1] = 1.0 / depth
        J_Y[:, :, 2] = -Y[:, :2] / depth[:, None] ** 2
        J_Y *= self.focal[m, j][:, None, None]
        J = np.concatenate([J_Y @ hat(Y), -J_Y, J_Y @ V[..., None]], -1)
        w = 1.0 / (1.0 + (r**2).sum(-1) / scale**2)
        H = np.einsum("n,nia,nib->ab", w, J, J, optimize=True)
        g = np.einsum("n,nia,ni->a", w, J, r, optimize=True)
        free = np.arange(6 if self.synchronised else 7)
        H[range(7), range(7)] *= 1.0 + 1e-3
        H[range(7), range(7)] += 1e-9 * np.trace(H)
        step = np.zeros(7)
        step[free] = -np.linalg.solve(H[np.ix_(free, free)], g[free])
        turn = step[:3] * min(1.0, MAX_TURN / max(float(np.linalg.norm(step[:3])), 1e-12))
        limit = MAX_SHIFT_FRAMES * self.last.observations.step_s
        return replace(
            at,
            R_ref_cam=at.R_ref_cam @ exp_so3(turn),
            t_ref_cam=at.t_ref_cam + at.R_ref_cam @ step[3:6],
            offset_s=at.offset_s + float(np.clip(step[6], -limit, limit)),
        )


def _row_table(last: Iteration) -> IntArray:
    """Row (P, K) of every person of a round at every knot; -1 where there is none."""
    o = last.observations
    _, person = np.unique(o.person, return_inverse=True)
    table: IntArray = np.full((int(person.max()) + 1, int(o.knot.max()) + 1), -1, dtype=np.int64)
    table[person.ravel(), o.knot] = np.arange(len(o.person))
    return table
