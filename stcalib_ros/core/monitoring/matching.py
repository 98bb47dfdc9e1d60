"""What all cameras saw in a few seconds, by person, on one clock: what a calibration is held to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from stcalib_ros.core.geometry.interpolation import Interpolation, frame_period
from stcalib_ros.core.geometry.lens import bearings, project
from stcalib_ros.core.integration.association import associate
from stcalib_ros.core.lifting.lift import lift_recording
from stcalib_ros.core.lifting.limits import NEAREST_M
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration
from stcalib_ros.core.model.clocks import clock_correction
from stcalib_ros.core.model.lifted import LiftedCamera, time_span
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.model.rolling_shutter import with_known_line_times
from stcalib_ros.core.model.skeleton import common_skeleton
from stcalib_ros.core.monitoring.limits import (
    BORDER_FRACTION,
    MAX_REASSOCIATION_M,
    MAX_REPROJECTION,
    MIN_OVERLAP,
    SAME_PLACE_M,
    TOLERANCE_PX,
)

RATE_HZ = 15.0
"""Images looked at, per second and camera: enough to interpolate a walking person."""
_SAMPLES_PER_S = 5.0
"""Time steps at which persons are compared, per second. Numerical: bounds the cost."""
_SLOT_SAMPLES = 50
"""Samples of a span in association, so that all of it is one slot; as `SLOT_SAMPLES` there."""
_MAX_JOINT_SAMPLES = 4000
"""Joints of all persons in one camera; with more people, fewer joints of each are compared."""
_SCALE_SAMPLES = 4
"""Time steps at which bodies are compared for the unit of length. Numerical: bounds the cost."""
_MAX_SCALES = 50
"""Candidates for the unit of length, at most. Numerical: bounds the cost."""


@dataclass(frozen=True, slots=True, eq=False)
class SpanObservations:
    """Persons as all cameras saw them at K moments.

    Attributes
    ----------
    names : tuple of str
        The C cameras.
    rig : Rig
        Of the calibration, metres; all on the reference clock.
    metres_per_unit : float
        Size of the unit of length of the calibration, by the size of the people.
    start_s, end_s : float
        By the reference clock, seconds since the Unix epoch.
    x : (C, N, K, J, 3) ndarray
        Key points of N persons on the plane z = 1; NaN where not seen.
    v : (C, N, K, J, 3) ndarray
        Their time derivative, per second.
    focal : (C, N, K, J) ndarray
        Pixels per unit of x.
    depth_m : (C,) ndarray
        Usual distance of the people, by their size; NaN where nobody was seen.
    seen, expected, matched : (C,) ndarray of int
        Moments at which a camera sees somebody; of these, those at which it should see a person
        whom at least two others see; and of these, those at which it sees such a person.
    blind : (C,) ndarray of int
        Moments at which it should see a person whom two others see, and sees nobody at all.
    tentative : (C,) ndarray of bool
        None of its persons was anybody's by the calibration; who is who is a guess by where they
        stand, to be believed if a change of the camera makes it fit.
    """

    names: tuple[str, ...]
    rig: Rig
    metres_per_unit: float
    start_s: float
    end_s: float
    x: Float64Array
    v: Float64Array
    focal: Float64Array
    depth_m: Float64Array
    seen: IntArray
    expected: IntArray
    matched: IntArray
    blind: IntArray
    tentative: BoolArray


def associate_span(
    recording: Recording, calibration: Calibration, *, min_score: float
) -> SpanObservations | None:
    """Find out who is who in a few seconds of images, by a calibration that may be out of date.

    Parameters
    ----------
    recording : Recording
        A few seconds of all cameras; those that the calibration does not know are left out.
    calibration : Calibration
    min_score : float
        Joints with a lower score are not used.

    Returns
    -------
    Sightings or None
        None if fewer than two of the calibration's cameras have images.
    """
    known = {camera.name: camera for camera in calibration.cameras}
    present = [camera for camera in recording.cameras if camera.name in known]
    cameras = tuple(_thinned(camera) for camera in present if len(camera.stamps))
    if len(cameras) < 2:
        return None
    poses = [known[camera.name] for camera in cameras]
    thinned = with_known_line_times(
        replace(recording, cameras=cameras), {pose.name: pose.line_time_s for pose in poses}
    )
    skeleton = common_skeleton(thinned)
    since_epoch_s = recording.epoch_ns * 1e-9 - calibration.epoch_s
    lifted = [
        _on_reference_clock(camera, pose, since_epoch_s)
        for camera, pose in zip(
            lift_recording(thinned, skeleton, min_score=min_score, turn=False), poses, strict=True
        )
    ]
    rig = _rig(poses)
    unit_m = metres_per_unit(lifted, rig)
    rig = replace(rig, t_ref_cam=rig.t_ref_cam * unit_m)
    return _sightings(thinned, lifted, rig, unit_m)


def _thinned(camera: CameraRecording) -> CameraRecording:
    """The same with about `RATE_HZ` images per second."""
    stride = max(1, int(1.0 / (RATE_HZ * frame_period(camera.stamps)) + 0.5))
    if stride == 1:
        return camera
    tracks = []
    for track in camera.tracks:
        rows = track.frames % stride == 0
        tracks.append(
            replace(
                track,
                frames=track.frames[rows] // stride,
                keypoints=track.keypoints[rows],
                joints=track.joints[rows],
                scores=track.scores[rows],
            )
        )
    return replace(camera, stamps=camera.stamps[::stride], tracks=tuple(tracks))


def _on_reference_clock(
    camera: LiftedCamera, pose: CameraCalibration, since_epoch_s: float
) -> LiftedCamera:
    correction_s = clock_correction(
        pose.time_offset_s, pose.clock_skew, camera.stamps + since_epoch_s
    )
    return replace(camera, stamps=camera.stamps + correction_s)


def _rig(poses: Sequence[CameraCalibration]) -> Rig:
    return Rig(
        np.arange(len(poses)),
        np.stack([pose.R_ref_cam for pose in poses]),
        np.stack([pose.t_ref_cam for pose in poses]),
        np.zeros(len(poses)),
        0.0,
    )


def metres_per_unit(cameras: Sequence[LiftedCamera], rig: Rig) -> float:
    """Size of the rig's unit of length that most people's places, by their size, agree with.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        On the reference clock.
    rig : Rig
        In any unit of length.

    Returns
    -------
    float
        1 if nobody is seen by two cameras.
    """
    start, end = time_span(cameras, rig.offset_s)
    times = np.linspace(start, end, _SCALE_SAMPLES + 2)[1:-1]
    bodies = [
        np.stack([_body(camera, track.joints_cam, track.frames, times) for track in camera.tracks])
        @ R.T
        if camera.tracks
        else np.zeros((0, _SCALE_SAMPLES, 3))
        for camera, R in zip(cameras, rig.R_ref_cam, strict=True)
    ]
    apart, baseline = [], []
    for a in range(len(cameras)):
        for b in range(a + 1, len(cameras)):
            difference = bodies[b][None] - bodies[a][:, None]
            both = np.isfinite(difference[..., 0])
            count = both.sum(-1)
            total = np.where(both[..., None], difference, 0.0).sum(2)
            found = total[count > 0] / count[count > 0][:, None]
            apart.append(found)
            baseline.append(np.tile(rig.t_ref_cam[a] - rig.t_ref_cam[b], (len(found), 1)))
    D, t = np.concatenate(apart), np.concatenate(baseline)
    scale = (D * t).sum(-1) / np.maximum((t * t).sum(-1), 1e-12)
    candidates = scale[scale > 0]
    candidates = candidates[:: max(1, len(candidates) // _MAX_SCALES)]
    if not len(candidates):
        return 1.0
    gap = np.linalg.norm(D - candidates[:, None, None] * t, axis=-1)
    agree = gap < SAME_PLACE_M
    best = int(agree.sum(-1).argmax())
    chosen = scale[agree[best]]
    return float(np.median(chosen)) if len(chosen) else float(candidates[best])


def _body(
    camera: LiftedCamera, joints_cam: Float64Array, frames: IntArray, times: Float64Array
) -> Float64Array:
    """Middle of a person (T, 3) in the optical frame."""
    period = frame_period(camera.stamps)
    at = Interpolation(camera.stamps[frames], times, period=period)
    known = np.isfinite(joints_cam)
    count = np.maximum(known.sum(1), 1)
    centre = np.where(known.any(1), np.where(known, joints_cam, 0.0).sum(1) / count, np.nan)
    return at(centre)


def _sightings(
    recording: Recording, cameras: Sequence[LiftedCamera], rig: Rig, unit_m: float
) -> SpanObservations:
    start, end = time_span(cameras, rig.offset_s)
    found = associate(
        cameras, rig, step_s=(end - start + 1e-3) / _SLOT_SAMPLES, floor_px=TOLERANCE_PX
    )
    K = max(2, round((end - start) * _SAMPLES_PER_S))
    times = start + (end - start) * (np.arange(K) + 0.5) / K
    C, N = len(cameras), max(found.n_persons, 1)
    joints = _joints_used(cameras, N * K)
    x, v = (np.full((C, N, K, len(joints), 3), np.nan) for _ in range(2))
    focal, body = np.full((C, N, K, len(joints)), np.nan), np.full((C, N, K, 3), np.nan)
    for c, camera in enumerate(cameras):
        period = frame_period(camera.stamps)
        for p, track in enumerate(camera.tracks):
            if (n := int(found.person_of[c][p, 0])) < 0:
                continue
            at = Interpolation(camera.stamps[track.frames], times, period=period)
            points = np.concatenate([track.x[:, joints], _ones(track.x[:, joints])], -1)
            places, rates = at.both(points)
            for out, values in (
                (x, places),
                (v, rates),
                (focal, at(track.focal[:, joints])),
                (body, _body(camera, track.joints_cam, track.frames, times)),
            ):
                here = np.isfinite(values.reshape(K, -1)).any(-1)
                out[c, n, here] = values[here]
    present = np.isfinite(body[..., 0])
    counted = _visibility(recording, rig, body, present)
    tentative = np.array([_reassign(c, rig, body, (x, v, focal)) for c in range(C)])
    epoch = recording.epoch_ns * 1e-9
    depth = [
        float(np.median(z[here])) if here.any() else np.nan
        for z, here in zip(body[..., 2], present, strict=True)
    ]
    return SpanObservations(
        tuple(camera.name for camera in cameras),
        rig,
        unit_m,
        epoch + start,
        epoch + end,
        x,
        v,
        focal,
        np.array(depth),
        **counted,
        tentative=tentative,
    )


def _reassign(c: int, rig: Rig, body: Float64Array, arrays: tuple[Float64Array, ...]) -> bool:
    """Give a camera whose persons are nobody's those who stand nearest, in place.

    Returns
    -------
    bool
        Whether it was done.
    """
    present = np.isfinite(body[..., 0])
    others = np.arange(len(body)) != c
    seen_by_others = present[others].any((0, 2))
    own = np.flatnonzero(present[c].any(-1))
    wanted = np.flatnonzero(seen_by_others)
    if seen_by_others[own].any() or not len(own) or not len(wanted):
        return False
    places = np.einsum("cij,cnkj->cnki", rig.R_ref_cam, body) + rig.t_ref_cam[:, None, None]
    n_others = present[others].sum(0)
    mean = np.where(present[others][..., None], places[others], 0.0).sum(0)
    with np.errstate(invalid="ignore"):
        mean = mean / np.where(n_others > 0, n_others, np.nan)[..., None]
    apart = np.linalg.norm(places[c, own][:, None] - mean[wanted][None], axis=-1)
    together = np.isfinite(apart).sum(-1) >= MIN_OVERLAP * apart.shape[-1]
    total = np.where(np.isfinite(apart), apart, 0.0).sum(-1)
    mean_apart = total / np.maximum(np.isfinite(apart).sum(-1), 1)
    cost = np.where(together, mean_apart, MAX_REASSOCIATION_M)
    rows, columns = linear_sum_assignment(np.minimum(cost, MAX_REASSOCIATION_M))
    near = cost[rows, columns] < MAX_REASSOCIATION_M
    for array in arrays:
        moved = array[c, own[rows[near]]].copy()
        array[c] = np.nan
        array[c, wanted[columns[near]]] = moved
    return bool(near.any())


def _ones(points: Float64Array) -> Float64Array:
    return np.where(np.isfinite(points[..., :1]), 1.0, np.nan)


def _joints_used(cameras: Sequence[LiftedCamera], n_bodies: int) -> IntArray:
    J = next((t.x.shape[1] for c in cameras for t in c.tracks), 1)
    stride = max(1, -(-J * n_bodies // _MAX_JOINT_SAMPLES))
    return np.arange(0, J, stride)


def _visibility(
    recording: Recording, rig: Rig, body: Float64Array, present: BoolArray
) -> Mapping[str, IntArray]:
    """Moments by camera: who is seen, and who should be."""
    C = len(body)
    places = np.einsum("cij,cnkj->cnki", rig.R_ref_cam, body) + rig.t_ref_cam[:, None, None]
    names = ("seen", "expected", "matched", "blind")
    counted = {name: np.zeros(C, dtype=np.int64) for name in names}
    for c in range(C):
        others = np.arange(C) != c
        n_others = present[others].sum(0)
        mean = np.where(present[others][..., None], places[others], 0.0).sum(0)
        mean /= np.maximum(n_others, 1)[..., None]
        local = (mean - rig.t_ref_cam[c]) @ rig.R_ref_cam[c]
        due = (n_others >= 2) & _in_view(local, recording.cameras[c])
        sees = present[c].any(0)
        counted["seen"][c] = sees.sum()
        counted["blind"][c] = (due.any(0) & ~sees).sum()
        counted["expected"][c] = (due.any(0) & sees).sum()
        counted["matched"][c] = (due.any(0) & (present[c] & (n_others >= 1)).any(0)).sum()
    return counted


def _in_view(points_cam: Float64Array, camera: CameraRecording) -> BoolArray:
    """Points (..., 3) whose image lies well inside of the image."""
    lens = camera.intrinsics
    pixels = project(points_cam, lens)
    x, _ = bearings(pixels, lens)
    size = np.array([lens.width, lens.height])
    with np.errstate(invalid="ignore", divide="ignore"):
        border = BORDER_FRACTION * size
        inside = ((pixels > border) & (pixels < size - border)).all(-1)
        # Far outside, a lens model may lead back into the image.
        true = np.abs(x - points_cam[..., :2] / points_cam[..., 2:]).max(-1) < MAX_REPROJECTION
    return np.asarray(inside & true & (points_cam[..., 2] > NEAREST_M))
