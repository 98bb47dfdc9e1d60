"""Errors of a calibration, as the paper defines them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.evaluation.lens_errors import LensError, lens_error, ray_alignment
from stcalib_ros.core.geometry.alignment import umeyama
from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.geometry.triangulation import triangulate, unit_rays
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.model.calibration import (
    Calibration,
    CameraCalibration,
    PersonAssociation,
)

_MIN_BASELINE = 1e-9
"""Distance of the first two cameras over the largest distance, below which there is no scale: equal
to rounding."""


@dataclass(frozen=True, slots=True)
class CameraError:
    """Errors of one camera.

    Attributes
    ----------
    name : str
    rotation_rad : float
        Angle between estimated and true orientation in the reference frame.
    translation : float
        Distance of the estimated from the true position in the reference frame, after scaling,
        over the true distance of the first two cameras.
    centre : float
        Distance from the true position after similarity alignment of all cameras, in the
        truth's unit.
    offset_s, offset_frames : float
        Estimated minus true time offset in the middle of the recording; frames are NaN without a
        frame rate.
    """

    name: str
    rotation_rad: float
    translation: float
    centre: float
    offset_s: float
    offset_frames: float


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Errors of a calibration; the capital letters are the paper's.

    Attributes
    ----------
    reference : str
        Camera in whose frame and clock the two are compared.
    cameras : tuple of CameraError
        Those in both, in the order of the truth.
    missing : tuple of str
        Cameras of the truth that are not in the estimate.
    E_R : float
        Mean rotation error of the cameras other than the reference, rad.
    E_t : float
        Root mean square of the translation errors of the cameras other than the reference.
    E_delta : float
        Mean absolute offset error of the cameras other than the reference, frames.
    E_delta_s : float
        The same in seconds.
    E_2D : float
        ``reprojection_rms_px`` of the estimate.
    centre_mean, centre_max : float
        Errors of the camera positions after similarity alignment, in the truth's unit.
    scale : float
        Estimated over true distance of the first two cameras.
    n_matches : int
        Number of pairs of tracks of different cameras that the estimate associates with one
        person and whose true persons are known.
    precision, recall : float
        Fraction of these that are right, and fraction of the true pairs among them; NaN without
        any.
    lenses : tuple of LensError
        Of the same cameras as `cameras`; with given lenses, how far these are from the true ones.
    E_R_rays, E_t_rays : float
        E_R and E_t if every camera is turned so that the rays of its pixels are nearest to those of
        the true lens: an error of a principal point is mostly a rotation.
    E_f : float
        Mean relative error of the focal lengths that were estimated; NaN without any.
    E_k1 : float
        Mean error of the k1 that were estimated; NaN without any, or if a lens has another model.
    """

    reference: str
    cameras: tuple[CameraError, ...]
    missing: tuple[str, ...]
    E_R: float
    E_t: float
    E_delta: float
    E_delta_s: float
    E_2D: float
    centre_mean: float
    centre_max: float
    scale: float
    n_matches: int
    precision: float
    recall: float
    lenses: tuple[LensError, ...] = ()
    E_R_rays: float = float("nan")
    E_t_rays: float = float("nan")
    E_f: float = float("nan")
    E_k1: float = float("nan")


def evaluate(estimate: Calibration, truth: Calibration, *, fps: float | None = None) -> Evaluation:
    """Compare a calibration with the truth, whatever their reference frames and scales.

    Both are expressed in the frame and by the clock of the truth's reference camera (or the first
    common camera, if the estimate lacks that); the scale is that of the first two cameras in the
    truth's order.

    Parameters
    ----------
    estimate, truth : Calibration
    fps : float, optional
        Frame rate for `Evaluation.E_delta`.

    Raises
    ------
    InputError
        The two have fewer than two cameras in common.

    Examples
    --------
    >>> import stcalib_ros as st
    >>> scene = st.simulate(st.SceneOptions(n_cameras=3, n_people=2, n_frames=180))
    >>> evaluation = st.evaluate(st.calibrate(scene.recording), scene.truth, fps=30.0)
    >>> bool(evaluation.E_R < 0.02), bool(evaluation.E_delta < 0.5)  # rad, frames
    (True, True)
    """
    names = _common_cameras(estimate, truth)
    reference = truth.reference if truth.reference in names else names[0]
    middle_s = 0.5 * sum(truth.window_s)
    ours = _expressed(estimate, names, reference, middle_s)
    right = _expressed(truth, names, reference, middle_s)
    scale, baseline = _scale(ours, right, names)
    angle, away = _pose_errors(ours, right, scale, baseline)
    pairs = _lens_pairs(estimate, truth, names)
    by_rays = _turned_by_rays(ours, pairs, names.index(reference))
    ray_angle, ray_away = _pose_errors(by_rays, right, scale, baseline)
    lenses = tuple(lens_error(*pair) for pair in pairs)
    centre = _centre_errors(ours.t_ref_cam, right.t_ref_cam)
    offset = ours.offset_s - right.offset_s
    frames = np.full(len(names), np.nan) if fps is None else offset * fps
    others = np.array(names) != reference
    n_matches, precision, recall = match_quality(estimate.persons, truth.persons, names)
    rows = zip(names, angle, away, centre, offset, frames, strict=True)
    return Evaluation(
        reference=reference,
        cameras=tuple(CameraError(name, *map(float, values)) for name, *values in rows),
        missing=tuple(c.name for c in truth.cameras if c.name not in names),
        E_R=float(angle[others].mean()),
        E_t=float(np.sqrt(np.mean(away[others] ** 2))),
        E_delta=float(np.abs(frames[others]).mean()),
        E_delta_s=float(np.abs(offset[others]).mean()),
        E_2D=estimate.reprojection_rms_px,
        centre_mean=float(centre.mean()),
        centre_max=float(centre.max()),
        scale=scale,
        n_matches=n_matches,
        precision=precision,
        recall=recall,
        lenses=lenses,
        E_R_rays=float(ray_angle[others].mean()),
        E_t_rays=float(np.sqrt(np.mean(ray_away[others] ** 2))),
        E_f=_mean_size([lens.focal for lens in lenses if lens.estimated]),
        E_k1=_mean_size([lens.radial[0] for lens in lenses if lens.estimated]),
    )


def _common_cameras(estimate: Calibration, truth: Calibration) -> list[str]:
    """Return the names of the cameras that both have, in the order of the truth."""
    known = {camera.name for camera in estimate.cameras}
    names = [camera.name for camera in truth.cameras if camera.name in known]
    if len(names) < 2:
        raise InputError(
            f"estimate and truth must have two cameras in common, got {names or 'none'}: the "
            f"estimate has {sorted(known)}, the truth {[c.name for c in truth.cameras]}"
        )
    return names


_LensPairs = Sequence[tuple[CameraCalibration, CameraCalibration]]
"""Of every camera, the estimate and the truth."""


def _lens_pairs(estimate: Calibration, truth: Calibration, names: Sequence[str]) -> _LensPairs:
    found = {camera.name: camera for camera in estimate.cameras}
    return [(found[true.name], true) for true in truth.cameras if true.name in names]


def _turned_by_rays(poses: _Expressed, pairs: _LensPairs, reference: int) -> _Expressed:
    """Turn cameras in their frames so that the rays of their pixels are those of the true lens."""
    R = np.stack([ray_alignment(found.intrinsics, true.intrinsics)[0] for found, true in pairs])
    R_ref = R[reference]
    return replace(
        poses,
        R_ref_cam=R_ref @ poses.R_ref_cam @ R.swapaxes(1, 2),
        t_ref_cam=poses.t_ref_cam @ R_ref.T,
    )


def _pose_errors(
    ours: _Expressed, right: _Expressed, scale: float, baseline: float
) -> tuple[Float64Array, Float64Array]:
    """Return the errors (C,) of rotations, rad, and of translations, over the first baseline."""
    angle = rotation_angle(right.R_ref_cam.swapaxes(1, 2) @ ours.R_ref_cam)
    away = np.linalg.norm(ours.t_ref_cam / scale - right.t_ref_cam, axis=-1) / baseline
    return angle, away


def _mean_size(errors: Sequence[float]) -> float:
    return float(np.mean(np.abs(errors))) if errors else float("nan")


def match_quality(
    estimated: Sequence[PersonAssociation], true: Sequence[PersonAssociation], names: Sequence[str]
) -> tuple[int, float, float]:
    """Compare the association of persons with the true one.

    A track may belong to several persons where a tracker exchanged identities; a match is right
    if its two tracks have a true person in common. Tracks unknown to the truth are ignored.

    Parameters
    ----------
    estimated, true : sequence of PersonAssociation
    names : sequence of str
        Names of the compared cameras.

    Returns
    -------
    n_matches : int
    precision, recall : float
        NaN without matches, or without true pairs.
    """
    right = _pairs(true, names)
    labelled = {track for pair in right for track in pair} | _tracks(true, names)
    matches = {p for p in _pairs(estimated, names) if p <= labelled}
    hits = len(matches & right)
    precision = hits / len(matches) if matches else float("nan")
    return len(matches), precision, hits / len(right) if right else float("nan")


_TrackKey = tuple[str, int]


def _tracks(persons: Sequence[PersonAssociation], names: Sequence[str]) -> set[_TrackKey]:
    return {(n, track) for p in persons for n in names for track in p.tracks.get(n, ())}


def _pairs(persons: Sequence[PersonAssociation], names: Sequence[str]) -> set[frozenset[_TrackKey]]:
    """Return the pairs of tracks of different cameras that show one person."""
    return {
        frozenset(pair)
        for person in persons
        for pair in combinations(sorted(_tracks([person], names)), 2)
        if pair[0][0] != pair[1][0]
    }


def triangulation_errors(
    R_ref_cam: Float64Array,
    t_ref_cam: Float64Array,
    x: Float64Array,
    focal: Float64Array,
    observed: BoolArray,
) -> Float64Array:
    """Compute reprojection errors (..., C), px, of points triangulated from their images.

    Parameters
    ----------
    R_ref_cam : (C, 3, 3) ndarray
    t_ref_cam : (C, 3) ndarray
    x : (..., C, 2) ndarray
        Keypoints on the planes z = 1; anything where not observed.
    focal : (..., C) ndarray
        Pixels per unit of x.
    observed : (..., C) ndarray of bool

    Returns
    -------
    (..., C) ndarray
        NaN where not observed, or where the rays determine no point.
    """
    rays = np.einsum("cij,...cj->...ci", R_ref_cam, unit_rays(x))
    centres = np.broadcast_to(t_ref_cam, rays.shape)
    X, _ = triangulate(centres, np.where(observed[..., None], rays, 0.0), observed.astype(float))
    Y = np.einsum("cij,...ci->...cj", R_ref_cam, X[..., None, :] - t_ref_cam)
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.linalg.norm(Y[..., :2] / Y[..., 2:] - x, axis=-1) * focal
    return np.where(observed & np.isfinite(error), error, np.nan)


def geometric_precision(
    R_ref_cam: Float64Array,
    t_ref_cam: Float64Array,
    x: Float64Array,
    focal: Float64Array,
    observed: BoolArray,
    *,
    limit_px: float = 5.0,
) -> float:
    """Compute P_5px, the paper's precision where true associations are unknown.

    This is the fraction of the matched keypoints to which a point triangulated with the true poses
    reprojects within `limit_px`. Noise alone reduces it: with sigma px per axis in two views,
    ``2 Phi(limit sqrt(2) / sigma) - 1`` is perfect.

    Parameters
    ----------
    R_ref_cam, t_ref_cam : ndarray
        True poses; further arguments as for `triangulation_errors`.
    limit_px : float
    """
    error = triangulation_errors(R_ref_cam, t_ref_cam, x, focal, observed)
    matched = observed & (observed.sum(-1) >= 2)[..., None]
    if not matched.any():
        return float("nan")
    return float((np.nan_to_num(error[matched], nan=np.inf) < limit_px).mean())


@dataclass(frozen=True, slots=True, eq=False)
class _Expressed:
    """Poses (C, ...) in the frame of one camera, offsets (C,) to its clock."""

    R_ref_cam: Float64Array
    t_ref_cam: Float64Array
    offset_s: Float64Array


def _expressed(
    calibration: Calibration, names: Sequence[str], reference: str, at_s: float
) -> _Expressed:
    cameras: Mapping[str, int] = {c.name: k for k, c in enumerate(calibration.cameras)}
    order = [cameras[name] for name in names]
    R = np.stack([calibration.cameras[k].R_ref_cam for k in order])
    t = np.stack([calibration.cameras[k].t_ref_cam for k in order])
    # All clocks are compared at the moment that the recording's own reference calls at_s.
    offset = np.array(
        [
            c.time_offset_s + c.clock_skew * (at_s - calibration.epoch_s)
            for c in (calibration.cameras[k] for k in order)
        ]
    )
    r = names.index(reference)
    return _Expressed(R[r].T @ R, (t - t[r]) @ R[r], offset - offset[r])


def _scale(ours: _Expressed, right: _Expressed, names: Sequence[str]) -> tuple[float, float]:
    """Return estimated over true distance of the first two cameras, and the true distance."""
    baseline = float(np.linalg.norm(right.t_ref_cam[1] - right.t_ref_cam[0]))
    estimated = float(np.linalg.norm(ours.t_ref_cam[1] - ours.t_ref_cam[0]))
    if min(_fraction(baseline, right), _fraction(estimated, ours)) < _MIN_BASELINE:
        raise InputError(
            f"cameras {names[0]!r} and {names[1]!r} are at one place: they give no scale"
        )
    return estimated / baseline, baseline


def _fraction(distance: float, poses: _Expressed) -> float:
    """Return a distance over the largest from the reference; 0 if all are at one place."""
    largest = float(np.linalg.norm(poses.t_ref_cam, axis=-1).max())
    return distance / largest if largest > 0 else 0.0


def _centre_errors(ours: Float64Array, right: Float64Array) -> Float64Array:
    """Return distances (C,) after similarity alignment (Umeyama), in the unit of the second."""
    s, R, t = umeyama(ours, right)
    return np.asarray(np.linalg.norm(s * ours @ R.T + t - right, axis=-1))
