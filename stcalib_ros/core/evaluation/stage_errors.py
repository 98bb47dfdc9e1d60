"""Errors of every stage: the rows PR, MI, BA, IBA, STBA, ISTBA of the paper's tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.residuals import errors_px
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.evaluation.metrics import (
    evaluate,
    geometric_precision,
    match_quality,
    triangulation_errors,
)
from stcalib_ros.core.geometry.alignment import unit
from stcalib_ros.core.geometry.interpolation import Interpolation, frame_period
from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.integration.association import Association
from stcalib_ros.core.integration.averaging import reliability
from stcalib_ros.core.model.arrays import BoolArray, Float32Array, Float64Array
from stcalib_ros.core.model.calibration import (
    Calibration,
    CameraCalibration,
    PersonAssociation,
    Status,
)
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.model.rig import Rig, sub_rig
from stcalib_ros.core.paper.registration import PairRegistration
from stcalib_ros.core.reconstruction.people import tracks_of
from stcalib_ros.core.registration.resampling import common_step
from stcalib_ros.core.stages import Stages


@dataclass(frozen=True, slots=True)
class Errors:
    """One row of the paper's tables; NaN where a stage has no such quantity.

    Attributes
    ----------
    E_R : float
        Mean rotation error, rad: of the cameras other than the reference, or of the pairs.
    E_t : float
        Root mean square translation error up to scale, over the distance of the first two
        cameras; of pairs, the mean distance of the unit vectors.
    E_2D : float
        Mean reprojection error of the triangulated points, px. The paper's printed values are
        means: with sigma px per axis two views cannot be below ``sigma / sqrt(pi)``.
    E_2D_rms : float
        The same as root mean square.
    E_delta : float
        Mean absolute offset error, frames.
    precision : float
        P: fraction of the matches that are right.
    P_5px : float
        Fraction of matched keypoints within five pixels with the true poses.
    n_matches : int
        Number of matches.
    missing : int
        Number of cameras, or pairs, without a result.
    """

    E_R: float
    E_t: float
    E_2D: float
    E_2D_rms: float
    E_delta: float
    precision: float
    P_5px: float
    n_matches: int
    missing: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class _MatchedPoints:
    """Keypoints of the same joints in C views: x (M, C, 2), focal and observed (M, C)."""

    x: Float64Array
    focal: Float64Array
    observed: BoolArray

    def errors(self, R_ref_cam: Float64Array, t_ref_cam: Float64Array) -> Float64Array:
        errors = triangulation_errors(R_ref_cam, t_ref_cam, self.x, self.focal, self.observed)
        return np.asarray(errors[np.isfinite(errors)])

    def within_5px(self, R_ref_cam: Float64Array, t_ref_cam: Float64Array) -> float:
        return geometric_precision(R_ref_cam, t_ref_cam, self.x, self.focal, self.observed)


def judge_pair(
    cameras: Sequence[LiftedCamera],
    found: PairRegistration,
    truth: Calibration,
    *,
    window: int,
    fps: float,
) -> Errors:
    """Compute the errors of two cameras registered on windows of `window` frames (Table III).

    Raises
    ------
    InputError
        The truth lacks one of the cameras.
    """
    h = found.hypothesis
    cam_a = cameras[h.a]
    step = common_step([cam_a, cameras[h.b]])
    within = step * np.arange(window)
    units = [
        (int(p), int(q), cam_a.stamps[0] + step * int(found.starts[w]) + within)
        for w, p, q in found.matches
    ]
    return _pair_errors(cameras, h, units, truth, fps)


def judge_stages(
    stages: Stages, truth: Calibration, *, fps: float, synchronised: bool = False
) -> dict[str, Errors]:
    """Compute the errors after each stage of a calibration by either method.

    Parameters
    ----------
    stages : Stages
    truth : Calibration
    fps : float
        Frame rate for `Errors.E_delta`.
    synchronised : bool
        Whether the rows are called BA and IBA instead of STBA and ISTBA.

    Returns
    -------
    dict of str to Errors
        Errors by row, for the stages that were reached: "PR", "MI", "STBA" or "BA", "ISTBA" or
        "IBA".
    """
    rows: dict[str, Errors] = {}
    if stages.hypotheses:
        rows["PR"] = _pairs_errors(stages, truth, fps)
    if stages.rigs and stages.iterations:
        first, last = stages.iterations[0], stages.iterations[-1]
        if (integrated := _integration_errors(stages, first, truth, fps)) is not None:
            rows["MI"] = integrated
        names = ("BA", "IBA") if synchronised else ("STBA", "ISTBA")
        rows[names[0]] = _round_errors(stages, first, truth, fps)
        rows[names[1]] = _round_errors(stages, last, truth, fps)
    return rows


def _pairs_errors(stages: Stages, truth: Calibration, fps: float) -> Errors:
    """Average over the pairs of cameras, with the most reliable hypothesis on each."""
    best: dict[tuple[int, int], RelativePose] = {}
    for h in stages.hypotheses:
        if (h.a, h.b) not in best or reliability(h) > reliability(best[h.a, h.b]):
            best[h.a, h.b] = h
    rows = []
    for h in best.values():
        camera = stages.lifted[h.a]
        units = [(p, q, camera.stamps[camera.tracks[p].frames]) for p, q in h.matches]
        rows.append(_pair_errors(stages.lifted, h, units, truth, fps))
    n = len(truth.cameras) * (len(truth.cameras) - 1) // 2
    n_matches = sum(row.n_matches for row in rows)
    right = [row.precision * row.n_matches for row in rows if row.n_matches]

    def mean(values: list[float]) -> float:
        return _mean(np.array([v for v in values if np.isfinite(v)]))

    return Errors(
        E_R=mean([row.E_R for row in rows]),
        E_t=mean([row.E_t for row in rows]),
        E_2D=mean([row.E_2D for row in rows]),
        E_2D_rms=mean([row.E_2D_rms for row in rows]),
        E_delta=mean([row.E_delta for row in rows]),
        precision=sum(right) / n_matches if n_matches else float("nan"),
        P_5px=mean([row.P_5px for row in rows]),
        n_matches=n_matches,
        missing=n - len(rows),
    )


_Unit = tuple[int, int, Float64Array]
"""Track of camera a, track of camera b, times by the clock of a."""


def _pair_errors(
    cameras: Sequence[LiftedCamera],
    h: RelativePose,
    units: Sequence[_Unit],
    truth: Calibration,
    fps: float,
) -> Errors:
    cam_a, cam_b = cameras[h.a], cameras[h.b]
    true_a, true_b = (_true_camera(truth, c.name) for c in (cam_a, cam_b))
    R = true_a.R_ref_cam.T @ true_b.R_ref_cam
    t = true_a.R_ref_cam.T @ (true_b.t_ref_cam - true_a.t_ref_cam)
    points = _pair_points(cam_a, cam_b, units, h.lag_s)
    errors = points.errors(np.stack([np.eye(3), h.R_a_b]), np.stack([np.zeros(3), h.t_a_b]))
    persons = _persons_of(truth)
    shared = [
        persons.get((cam_a.name, cam_a.tracks[p].track_id), set())
        & persons.get((cam_b.name, cam_b.tracks[q].track_id), set())
        for p, q, _ in units
    ]
    lag_s = true_a.time_offset_s - true_b.time_offset_s
    return Errors(
        E_R=float(rotation_angle(R.T @ h.R_a_b)),
        E_t=float(np.linalg.norm(unit(h.t_a_b) - unit(t))),
        E_2D=_mean(errors),
        E_2D_rms=float(np.sqrt(_mean(errors**2))),
        E_delta=abs(h.lag_s - lag_s) * fps,
        precision=_mean(np.array([bool(s) for s in shared], dtype=float)),
        P_5px=points.within_5px(np.stack([np.eye(3), R]), np.stack([np.zeros(3), t])),
        n_matches=len(units),
    )


def _pair_points(
    cam_a: LiftedCamera, cam_b: LiftedCamera, units: Sequence[_Unit], lag_s: float
) -> _MatchedPoints:
    parts = []
    for p, q, times in units:
        x_a, focal_a = _read(cam_a, p, times)
        x_b, focal_b = _read(cam_b, q, times + lag_s)
        x, focal = np.stack([x_a, x_b], -2), np.stack([focal_a, focal_b], -1)
        both = np.isfinite(x).all((-1, -2))
        parts.append((x[both], focal[both]))
    if not parts:
        return _MatchedPoints(np.zeros((0, 2, 2)), np.zeros((0, 2)), np.zeros((0, 2), dtype=bool))
    x, focal = (np.concatenate(part) for part in zip(*parts, strict=True))
    return _MatchedPoints(x, focal, np.ones(focal.shape, dtype=bool))


def _read(camera: LiftedCamera, p: int, times: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return joints (K, J, 2) and focal lengths (K, J) of a track at times of its clock."""
    track = camera.tracks[p]
    at = Interpolation(camera.stamps[track.frames], times, period=frame_period(camera.stamps))
    return at(track.x), at(track.focal)


def _integration_errors(
    stages: Stages, first: Iteration, truth: Calibration, fps: float
) -> Errors | None:
    """Compute the errors of the best supported rig with the first association."""
    whole = stages.rigs[0]
    of = {int(c): a for c, a in zip(first.rig.cameras, first.association.person_of, strict=True)}
    members = [i for i, c in enumerate(whole.cameras) if int(c) in of]
    if len(members) < 2:
        return None
    rig = sub_rig(whole, members)
    person_of = tuple(of[int(c)] for c in rig.cameras)
    association = replace(first.association, person_of=person_of)
    points = _rig_points(stages.lifted, rig, association)
    errors = points.errors(rig.R_ref_cam, rig.t_ref_cam)
    return _rig_errors(stages.lifted, rig, association, points, errors, truth, fps)


def _round_errors(stages: Stages, done: Iteration, truth: Calibration, fps: float) -> Errors:
    errors = errors_px(done.observations, done.state)
    errors = errors[done.state.inlier & np.isfinite(errors)]
    points = _rig_points(stages.lifted, done.rig, done.association)
    return _rig_errors(stages.lifted, done.rig, done.association, points, errors, truth, fps)


def _rig_errors(
    cameras: Sequence[LiftedCamera],
    rig: Rig,
    association: Association,
    points: _MatchedPoints,
    errors: Float32Array | Float64Array,
    truth: Calibration,
    fps: float,
) -> Errors:
    persons = tuple(
        PersonAssociation(person, tracks, float("nan"))
        for person in range(association.n_persons)
        if len(tracks := tracks_of(cameras, rig, association, (person,))) >= 2
    )
    found = evaluate(_calibration(cameras, rig, persons, truth), truth, fps=fps)
    names = [cameras[c].name for c in rig.cameras]
    n_matches, precision, _ = match_quality(persons, truth.persons, names)
    true = [_true_camera(truth, name) for name in names]
    return Errors(
        E_R=found.E_R,
        E_t=found.E_t,
        E_2D=_mean(errors),
        E_2D_rms=float(np.sqrt(_mean(errors**2))),
        E_delta=found.E_delta,
        precision=precision,
        P_5px=points.within_5px(
            np.stack([c.R_ref_cam for c in true]), np.stack([c.t_ref_cam for c in true])
        ),
        n_matches=n_matches,
        missing=len(found.missing),
    )


def _rig_points(
    cameras: Sequence[LiftedCamera], rig: Rig, association: Association
) -> _MatchedPoints:
    """Interpolate the associated joints at common times by the offsets of the rig."""
    members = [cameras[c] for c in rig.cameras]
    step = common_step(members)
    n = int(association.person_of[0].shape[1] * association.slot_s / step) + 1
    times: Float64Array = association.start_s + step * np.arange(n, dtype=np.float64)
    slot = association.slot(times)
    J = next(t.x.shape[1] for m in members for t in m.tracks)
    x = np.full((association.n_persons, n, J, len(members), 2), np.nan)
    focal = np.ones(x.shape[:-1])
    for i, camera in enumerate(members):
        for p in range(len(camera.tracks)):
            person = association.person_of[i][p][slot]
            x_p, focal_p = _read(camera, p, times - rig.offset_s[i])
            k = np.flatnonzero((person >= 0) & np.isfinite(x_p).any((-1, -2)))
            x[person[k], k, :, i], focal[person[k], k, :, i] = x_p[k], focal_p[k]
    observed: BoolArray = np.asarray(np.isfinite(x).all(-1))
    matched = observed.sum(-1) >= 2
    return _MatchedPoints(
        np.nan_to_num(x[matched]), np.nan_to_num(focal[matched], nan=1.0), observed[matched]
    )


def _calibration(
    cameras: Sequence[LiftedCamera],
    rig: Rig,
    persons: tuple[PersonAssociation, ...],
    truth: Calibration,
) -> Calibration:
    """Return a rig as a `Calibration`, for `evaluate`."""
    poses = []
    for i, c in enumerate(rig.cameras):
        true = _true_camera(truth, cameras[c].name)
        poses.append(
            CameraCalibration(
                name=true.name,
                frame_id=true.frame_id,
                intrinsics=true.intrinsics,
                R_ref_cam=rig.R_ref_cam[i],
                t_ref_cam=rig.t_ref_cam[i],
                covariance=np.full((6, 6), np.nan),
                time_offset_s=float(rig.offset_s[i]),
                time_offset_stddev_s=float("nan"),
            )
        )
    return Calibration(
        status=Status.OK,
        message="one stage",
        reference=cameras[rig.cameras[0]].name,
        metric=False,
        epoch_s=truth.epoch_s,
        window_s=truth.window_s,
        cameras=tuple(poses),
        uncalibrated=(),
        persons=persons,
        pairs=(),
        reprojection_rms_px=float("nan"),
        n_observations=0,
        n_inliers=0,
    )


def _true_camera(truth: Calibration, name: str) -> CameraCalibration:
    for camera in truth.cameras:
        if camera.name == name:
            return camera
    raise InputError(f"the truth lacks camera {name!r}: it has {[c.name for c in truth.cameras]}")


def _persons_of(truth: Calibration) -> Mapping[tuple[str, int], set[int]]:
    persons: dict[tuple[str, int], set[int]] = {}
    for person in truth.persons:
        for name, tracks in person.tracks.items():
            for track in tracks:
                persons.setdefault((name, track), set()).add(person.person_id)
    return persons


def _mean(values: Float32Array | Float64Array) -> float:
    return float(np.mean(values)) if len(values) else float("nan")
