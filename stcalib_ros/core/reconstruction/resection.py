"""Resection of a camera that was left out, from the people that the other cameras reconstruct.

Their joints are known in space and time by then, and are registered with the camera like those of
another camera without errors. From there its keypoints are fitted to the joints (resection, or PnP,
with the time offset as a seventh unknown), which determines the persons, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.limits import (
    NEAREST,
    OTHER_OFFSET_FRAMES,
    OTHER_POSITION,
    OTHER_ROTATION,
)
from stcalib_ros.core.bundle.parameters import ROTATION, TIME_OFFSET, TRANSLATION, ParameterLayout
from stcalib_ros.core.geometry.so3 import exp_so3, hat, rotation_angle
from stcalib_ros.core.integration.association import SLOT_SAMPLES
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rig import Rig, sub_rig
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.options import Options
from stcalib_ros.core.reconstruction.limits import (
    FIT_SCALE_PX,
    MIN_FIT,
    PERSON_SCALE_RATIO,
    RIVAL_FIT_RATIO,
)
from stcalib_ros.core.reconstruction.people import people_as_observed
from stcalib_ros.core.registration.epipolar_correlation import keypoint_moments
from stcalib_ros.core.registration.pairs import PairTask, register
from stcalib_ros.core.registration.pieces import cut_tracks, longest, whole_tracks
from stcalib_ros.core.registration.resampling import common_grid

_MAX_IMAGES = 300
"""Poses of the camera, count; of more, a regular part is used. Cost alone."""

_MAX_VIEWS = 50_000
"""Images times persons, count. All persons are compared with every image: bounds the memory where
ids break, and one person is many. Numerical."""
_STEPS = 15
"""Steps of one fit at most; persons are associated anew in each."""
_MIN_STEPS = 5
"""Steps before a fit may end: at first the association of persons still changes."""
_MIN_GAIN = 0.002
"""Increase of the fraction of fitting keypoints per step below which a fit has converged."""
_MAX_TURN = 0.2
"""Radians. Longest rotation of one step, about the domain of its linearization."""
_MAX_SHIFT_FRAMES = 2.0
"""Frames. Largest change of the time offset in one step: joints move as in their time bin only
nearby."""


@dataclass(frozen=True, slots=True, eq=False)
class Resection:
    """Pose and time offset of a camera.

    Attributes
    ----------
    R_ref_cam : (3, 3) ndarray
    t_ref_cam : (3,) ndarray
        Position in the frame and unit of the rig.
    offset_s : float
        Time offset, seconds.
    explained : float
        Fraction of its keypoints that fit, each weighted by how well.
    """

    R_ref_cam: Float64Array
    t_ref_cam: Float64Array
    offset_s: float
    explained: float

    def differs(self, other: Resection, frame_s: float) -> bool:
        """Whether the two are different solutions."""
        angle = float(rotation_angle(self.R_ref_cam.T @ other.R_ref_cam))
        distance = float(np.linalg.norm(self.t_ref_cam - other.t_ref_cam))
        frames = abs(self.offset_s - other.offset_s) / frame_s
        return angle > OTHER_ROTATION or distance > OTHER_POSITION or frames > OTHER_OFFSET_FRAMES


def resect(
    cameras: Sequence[LiftedCamera],
    index: int,
    skeleton: Skeleton,
    last: Iteration,
    options: Options,
) -> Resection | None:
    """Estimate pose and time offset of a camera that is not in the rig of an iteration.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    index : int
        Index of the camera to be added.
    skeleton : Skeleton
    last : Iteration
        Adjustment of the other cameras.
    options : Options

    Returns
    -------
    Resection or None
        None where nothing fits, or another solution fits about as well.
    """
    frame_s = last.observations.step_s
    keypoints = _Keypoints(cameras[index], last, synchronised=options.synchronised)
    fitted = (keypoints.fit(start) for start in _starts(cameras[index], skeleton, last, options))
    found = sorted(fitted, key=lambda one: -one.explained)
    if not found or found[0].explained < MIN_FIT:
        return None
    best, *others = found
    rivals = (other for other in others if other.differs(best, frame_s))
    if any(other.explained > RIVAL_FIT_RATIO * best.explained for other in rivals):
        return None
    return best


def add_cameras(
    cameras: Sequence[LiftedCamera], rig: Rig, found: dict[int, Resection], order: Sequence[int]
) -> Rig:
    """Add cameras to a rig; the first one in the order that it has becomes the reference."""
    lenses = [lens for c in found if (lens := cameras[c].intrinsics) is not None]
    grown = replace(
        rig,
        cameras=np.concatenate([rig.cameras, np.array(list(found), dtype=np.int64)]),
        R_ref_cam=np.concatenate([rig.R_ref_cam, [f.R_ref_cam for f in found.values()]]),
        t_ref_cam=np.concatenate([rig.t_ref_cam, [f.t_ref_cam for f in found.values()]]),
        offset_s=np.concatenate([rig.offset_s, [f.offset_s for f in found.values()]]),
        lenses=(*rig.lenses, *lenses) if rig.lenses else (),
    )
    place = {int(c): i for i, c in enumerate(grown.cameras)}
    return sub_rig(grown, [place[c] for c in order if c in place])


def _starts(
    camera: LiftedCamera, skeleton: Skeleton, last: Iteration, options: Options
) -> list[Resection]:
    """Return candidates by epipolar correlation with the people as one of the others has them."""
    view = int(last.observations.observed.sum((0, 2)).argmax())
    people = people_as_observed(last, view)
    pieces = (whole_tracks(people), longest(cut_tracks(camera, skeleton.layout)))
    grid = common_grid((people, camera), last.observations.step_s)
    task = PairTask(
        0,
        1,
        pieces,
        (keypoint_moments(pieces[0].camera, grid), keypoint_moments(pieces[1].camera, grid)),
        grid.step_s,
        int(np.ceil(2.0 * options.offset_range_s / grid.step_s)),
        options.registration,
        options.synchronised,
    )
    R_ref_view, t_ref_view = last.rig.R_ref_cam[view], last.rig.t_ref_cam[view]
    return [
        Resection(R_ref_view @ h.R_a_b, t_ref_view + R_ref_view @ h.t_a_b, -h.lag_s, 0.0)
        for h in register(task)
    ]


class _Predicted(NamedTuple):
    """Projections of every person into some images: residuals, points and velocities."""

    r: Float64Array  # (P, M, J, 2), px
    Y: Float64Array  # (P, M, J, 3), joints in the frame of the camera
    V: Float64Array  # (P, M, J, 3), their velocities in the frame of the camera, per second


class _Keypoints:
    """Keypoints of one camera, thinned, to be fitted to the people of an adjustment."""

    def __init__(self, camera: LiftedCamera, last: Iteration, *, synchronised: bool) -> None:
        self.last, self.synchronised = last, synchronised
        total = sum(len(track.frames) for track in camera.tracks)
        self.row_of = _row_table(last)
        every = max(1, total // min(_MAX_IMAGES, max(1, _MAX_VIEWS // len(self.row_of))))
        parts = [(t, q, slice(None, None, every)) for q, t in enumerate(camera.tracks)]
        self.times: Float64Array = np.concatenate([camera.stamps[t.frames[s]] for t, _, s in parts])
        self.x: Float64Array = np.concatenate([t.x[s] for t, _, s in parts]).astype(np.float64)
        self.focal: Float64Array = np.concatenate([t.focal[s] for t, _, s in parts])
        self.track: IntArray = np.concatenate(
            [np.full(len(t.frames[s]), q, dtype=np.int64) for t, q, s in parts]
        )
        self.n_points = max(int(np.isfinite(self.x[..., 0]).sum()), 1)

    def fit(self, start: Resection) -> Resection:
        """Minimize the robust reprojection error by Gauss-Newton, with persons by each step."""
        best, at = start, start
        for step in range(_STEPS):
            predicted = self._predicted(at)
            error = np.linalg.norm(predicted.r, axis=-1)
            chosen = self._persons(error, at)
            mine = error[chosen, np.arange(len(chosen))]
            known = np.isfinite(mine) & (chosen >= 0)[:, None]
            if not known.any():
                return best
            weight = np.where(known, 1.0 / (1.0 + (mine / FIT_SCALE_PX) ** 2), 0.0)
            at = replace(at, explained=float(weight.sum()) / self.n_points)
            if step > _MIN_STEPS and at.explained < best.explained + _MIN_GAIN:
                return max(best, at, key=lambda one: one.explained)
            best = max(best, at, key=lambda one: one.explained)
            scale = max(FIT_SCALE_PX, float(np.median(mine[known])))
            at = self._step(at, predicted, chosen, known, scale)
        return best

    def _predicted(self, at: Resection) -> _Predicted:
        obs, state = self.last.observations, self.last.state
        since = self.times + at.offset_s - obs.start_s
        bins = np.rint(since / obs.step_s).astype(np.int64)
        inside = (bins >= 0) & (bins < self.row_of.shape[1])
        row = np.where(inside, self.row_of[:, np.where(inside, bins, 0)], -1)
        when = (since - bins * obs.step_s)[:, None, None]
        V = state.V[row] + when * state.A[row]
        X = state.X[row] + when * (state.V[row] + 0.5 * when * state.A[row])
        known = (state.inlier[row].sum(2) >= 2) & (row >= 0)[..., None]
        Y = (np.where(known[..., None], X, np.nan) - at.t_ref_cam) @ at.R_ref_cam
        Y[Y[..., 2] < NEAREST] = np.nan
        r = (Y[..., :2] / Y[..., 2:] - self.x) * self.focal[..., None]
        return _Predicted(r, Y, V @ at.R_ref_cam)

    def _persons(self, error: Float64Array, at: Resection) -> IntArray:
        """Return the person (M,) in every image of a track, one per slot; -1 where none fits."""
        slot_s = SLOT_SAMPLES * self.last.observations.step_s
        slot = np.floor((self.times + at.offset_s) / slot_s).astype(np.int64)
        scale_px = PERSON_SCALE_RATIO * FIT_SCALE_PX
        fits = np.nan_to_num(1.0 / (1.0 + (error / scale_px) ** 2)).sum(-1)
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
        """Return pose and time offset after one Gauss-Newton step."""
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
        layout = ParameterLayout(1)
        n = layout.within(TIME_OFFSET).start if self.synchronised else layout.block
        H[range(len(H)), range(len(H))] *= 1.0 + 1e-3
        H[range(len(H)), range(len(H))] += 1e-9 * np.trace(H)
        step, free = np.zeros(layout.block), np.arange(n)
        step[free] = -np.linalg.solve(H[np.ix_(free, free)], g[free])
        rotation, translation, (late,) = (
            step[layout.within(one)] for one in (ROTATION, TRANSLATION, TIME_OFFSET)
        )
        turn = rotation * min(1.0, _MAX_TURN / max(float(np.linalg.norm(rotation)), 1e-12))
        limit = _MAX_SHIFT_FRAMES * self.last.observations.step_s
        return replace(
            at,
            R_ref_cam=at.R_ref_cam @ exp_so3(turn),
            t_ref_cam=at.t_ref_cam + at.R_ref_cam @ translation,
            offset_s=at.offset_s + float(np.clip(late, -limit, limit)),
        )


def _row_table(last: Iteration) -> IntArray:
    """Return the row (P, K) of every person in every time bin; -1 where there is none."""
    obs = last.observations
    _, person = np.unique(obs.person, return_inverse=True)
    shape = (int(person.max()) + 1, int(obs.time_bin.max()) + 1)
    table: IntArray = np.full(shape, -1, dtype=np.int64)
    table[person.ravel(), obs.time_bin] = np.arange(len(obs.person))
    return table
