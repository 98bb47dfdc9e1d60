"""ARCS and ReID-Calib as registrations of a pair, and the paper's later stages after either."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np

from benchmarks.paper.arcs import arcs, proposals
from benchmarks.paper.reid import (
    MIN_POINTS,
    RANK_1,
    embeddings,
    matched,
    noise_for,
    prototypes,
    relative_pose,
)
from stcalib_ros.core.bundle.istba import finish_iteration
from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.observations import observe
from stcalib_ros.core.bundle.outliers import image_points
from stcalib_ros.core.bundle.state import initial_state
from stcalib_ros.core.integration.association import Association
from stcalib_ros.core.integration.exclusions import Disconnected
from stcalib_ros.core.lifting.views import LiftedViews, lift_views
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.model.rig import Rig, sub_rig
from stcalib_ros.core.options import Options, VmfOptions
from stcalib_ros.core.output.assemble import failed_calibration
from stcalib_ros.core.paper.matching import match, mean_angles
from stcalib_ros.core.paper.merge import merge
from stcalib_ros.core.paper.oriented import OrientedPoints, oriented_points, spread_windows
from stcalib_ros.core.paper.posegraph import optimise
from stcalib_ros.core.paper.registration import PairRegistration
from stcalib_ros.core.paper.stba import adjust_rounds
from stcalib_ros.core.paper.translation import translation_direction
from stcalib_ros.core.registration.resampling import common_step
from stcalib_ros.core.stages import Stages

MAX_PROPOSALS = 8000
"""More proposed correspondences than this are thinned out at random before ARCS."""

_SHORTEST_M = 1e-3
"""Shortest baseline that a pair is given, m."""

Register = Callable[
    ["Sampled", int, int, VmfOptions, np.random.Generator], "PairRegistration | None"
]


class Sampled:
    """All cameras of a synchronised recording on one grid, with the windows to use.

    Parameters
    ----------
    views : Views
    truth : Calibration
        Truth from which the appearance of people is simulated; not used otherwise.
    starts : (W,) ndarray of int
    """

    def __init__(self, views: LiftedViews, truth: Calibration, starts: IntArray) -> None:
        self.views, self.truth, self.starts = views, truth, starts
        cameras = views.lifted
        self.step_s = common_step(cameras)
        self.start_s = min(float(c.stamps[0]) for c in cameras)
        end = max(float(c.stamps[-1]) for c in cameras)
        self.n = round((end - self.start_s) / self.step_s) + 1
        self.points: list[OrientedPoints] = [
            oriented_points(c, views.skeleton, start=self.start_s, step=self.step_s, n=self.n)
            for c in cameras
        ]

    def samples(self, window: int) -> IntArray:
        """Samples (W, T) of the windows."""
        return self.starts[:, None] + np.arange(window)

    def persons(self, c: int) -> IntArray:
        """True persons (P,) of the tracks of a camera."""
        camera = self.views.lifted[c]
        return np.array([self._person(camera.name, t.track_id) for t in camera.tracks])

    def _person(self, camera: str, track_id: int) -> int:
        for k, person in enumerate(self.truth.persons):
            if track_id in person.tracks.get(camera, ()):
                return k
        return len(self.truth.persons)


def by_arcs(
    s: Sampled, a: int, b: int, o: VmfOptions, rng: np.random.Generator
) -> PairRegistration | None:
    """ARCS on the direction sets of all windows; persons by bipartite matching as in the paper."""
    at = s.samples(o.window)
    (v_a, k_a), (v_b, k_b) = ((s.points[c].v[:, at], s.points[c].known[:, at] > 0) for c in (a, b))
    shape_a, shape_b = ((len(v), -1, *v.shape[3:]) for v in (v_a, v_b))
    left, right = proposals(
        v_a.reshape(shape_a),
        k_a.reshape(shape_a[:-1]),
        v_b.reshape(shape_b),
        k_b.reshape(shape_b[:-1]),
    )
    if len(left) < MIN_POINTS:
        return None
    keep = rng.permutation(len(left))[:MAX_PROPOSALS]
    R = arcs(left[keep], right[keep]).R_a_b
    known_a, known_b = (np.asarray(k, dtype=np.float64) for k in (k_a, k_b))
    angles = mean_angles(v_a, known_a, v_b[:, None], known_b[:, None], R[None])[0]
    A = match(angles, o.no_match_rad)
    return _registration(s, a, b, R, np.argwhere(A), o.window)


def by_reid(
    s: Sampled, a: int, b: int, o: VmfOptions, rng: np.random.Generator
) -> PairRegistration | None:
    """Essential matrix from people of similar appearance."""
    n_people = len(s.truth.persons)
    looks = prototypes(np.random.default_rng(n_people), n_people + 1)
    noise = noise_for(RANK_1, max(2, n_people))
    e_a, e_b = (embeddings(rng, s.persons(c), looks, noise) for c in (a, b))
    at = s.samples(o.window)
    x_a, x_b = (
        s.points[c].x[:, at].reshape(len(s.points[c].x), -1, *s.points[c].x.shape[2:])
        for c in (a, b)
    )
    focal = float(np.sqrt(np.nanmedian(s.points[a].focal) * np.nanmedian(s.points[b].focal)))
    found = relative_pose(a, b, x_a, x_b, matched(e_a, e_b), focal)
    if found is None:
        return None
    matches = np.array(
        [(w, p, q) for w in range(len(s.starts)) for p, q in found.matches], dtype=np.int64
    ).reshape(-1, 3)
    h = replace(found, t_a_b=found.t_a_b * _length(s, found, matches, o.window))
    return PairRegistration(h, s.starts, matches, float("nan"))


def _of_windows(x: Float64Array, at: IntArray) -> Float64Array:
    """Joints (P, W T, J, 2) in the samples (W, T) of the windows."""
    return np.asarray(x[:, at.ravel()])


BASELINES: dict[str, Register] = {"ARCS": by_arcs, "ReID-Calib": by_reid}


def _registration(
    s: Sampled, a: int, b: int, R: Float64Array, matches: IntArray, window: int
) -> PairRegistration | None:
    """Translation from the epipolar constraint, as after the paper's own rotation."""
    w, p, q = matches.T
    at = s.samples(window)[w]
    x_a, x_b = s.points[a].x[p[:, None], at], s.points[b].x[q[:, None], at]
    both = np.isfinite(x_a + x_b).all(-1)
    if both.sum() < MIN_POINTS:
        return None
    one = np.ones((int(both.sum()), 1))
    t = translation_direction(R, np.hstack([x_a[both], one]), np.hstack([x_b[both], one]))
    pairs = tuple(sorted({(int(i), int(j)) for i, j in zip(p, q, strict=True)}))
    h = RelativePose(a, b, R, t, 0.0, pairs, float(len(matches)))
    h = replace(h, t_a_b=t * _length(s, h, matches, window))
    return PairRegistration(h, s.starts, matches, float("nan"))


def _length(s: Sampled, h: RelativePose, matches: IntArray, window: int) -> float:
    """Length of t, metres, from the positions of the monocular poses."""
    w, p, q = matches.T
    at = s.samples(window)[w]
    difference = s.points[h.a].body[p[:, None], at] - s.points[h.b].body[q[:, None], at] @ h.R_a_b.T
    along = difference[np.isfinite(difference).all(-1)] @ h.t_a_b
    return max(abs(float(np.median(along))), _SHORTEST_M) if len(along) else 1.0


def baseline_stages(
    name: str, recording: Recording, truth: Calibration, options: Options, *, seed: int
) -> Stages:
    """PR by a baseline, then MI, BA and IBA as the paper has them.

    Parameters
    ----------
    name : str
        Name in `BASELINES`.
    recording : Recording
        Synchronised.
    truth : Calibration
        Generator for the simulated appearance.
    options : Options
        Options of the paper's method.
    seed : int
    """
    views = lift_views(recording, options)
    o = options.vmf
    s = Sampled(views, truth, np.zeros(0, dtype=np.int64))
    s.starts = spread_windows(s.n, o.window, o.n_windows)
    rng = np.random.default_rng(seed)
    every = combinations(range(len(views.lifted)), 2)
    found = [BASELINES[name](s, a, b, o, rng) for a, b in every]
    pairs = [pair for pair in found if pair is not None]
    return _integrated(s, pairs, options, recording)


def _integrated(
    s: Sampled, pairs: list[PairRegistration], options: Options, recording: Recording
) -> Stages:
    cameras = list(range(len(s.views.lifted)))
    hypotheses = tuple(pair.hypothesis for pair in pairs)
    none = failed_calibration(recording, status=Status.NOT_CONVERGED, rejections=())
    empty = Stages(s.views.skeleton, s.views.lifted, hypotheses, (), (), none)
    reached = {c for h in hypotheses for c in (h.a, h.b)}
    if reached != set(cameras) or len(pairs) < len(cameras) - 1:
        return empty
    rig = optimise(cameras, hypotheses, synchronised=True)
    rounds = _rounds(s, rig, pairs, options)
    return replace(empty, rigs=(rig,), iterations=rounds)


def _rounds(
    s: Sampled, rig: Rig, pairs: list[PairRegistration], options: Options
) -> tuple[Iteration, ...]:
    """Integration and adjustments; of disconnected cameras the largest group is kept."""
    lifted, window = s.views.lifted, options.vmf.window
    first = _association(s, rig, pairs, window)
    before = _unadjusted(s, rig, first)
    if before is None:
        return ()
    while True:
        association = _association(s, rig, pairs, window)
        result = adjust_rounds(
            lifted,
            rig,
            association,
            options.bundle,
            step_s=s.step_s,
            window=window,
            tick=lambda _: None,
        )
        if not isinstance(result, Disconnected):
            return (before, *result)
        if len(result.groups[0]) < 2:
            return (before,)
        rig = sub_rig(rig, result.groups[0])


def _association(s: Sampled, rig: Rig, pairs: list[PairRegistration], window: int) -> Association:
    inside = set(rig.cameras.tolist())
    return merge(
        s.views.lifted,
        rig,
        [p for p in pairs if {p.hypothesis.a, p.hypothesis.b} <= inside],
        start_s=s.start_s,
        step_s=s.step_s,
        window=window,
    )


def _unadjusted(s: Sampled, rig: Rig, association: Association) -> Iteration | None:
    """The integration as a round of which nothing was adjusted."""
    observations = observe(s.views.lifted, rig, association, step_s=s.step_s)
    if not len(observations.person):
        return None
    state = initial_state(observations, rig)
    total = image_points([s.views.lifted[c] for c in rig.cameras])
    return finish_iteration(rig, association, observations, state, total)
