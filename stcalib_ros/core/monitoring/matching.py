"""Observations of a few seconds, by person and on one clock, by a calibration that may be wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from stcalib_ros.core.geometry.interpolation import Interpolation, frame_period
from stcalib_ros.core.geometry.lens import bearings, project
from stcalib_ros.core.integration.association import SLOT_SAMPLES, Association, associate
from stcalib_ros.core.lifting.input_screening import readable_input
from stcalib_ros.core.lifting.lift import lift_recording
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, FloatArray, IntArray
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration
from stcalib_ros.core.model.clocks import clock_correction
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack, time_span
from stcalib_ros.core.model.recording import CameraRecording, Recording, only_images
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.model.rolling_shutter import with_known_line_times
from stcalib_ros.core.model.skeleton import common_skeleton
from stcalib_ros.core.monitoring.lenses import with_lenses_in_force
from stcalib_ros.core.monitoring.limits import (
    ASSOCIATION_TOLERANCE_PX,
    IMAGE_BORDER,
    MAX_LENS_RESIDUAL,
    MAX_REASSIGNED_M,
    MIN_COMMON_FRACTION,
    MIN_DISTANCE_M,
    SAME_PLACE_M,
)

RATE_HZ = 15.0
"""Used images per second and camera: enough to interpolate a walking person; cost alone."""
SAMPLES_PER_S = 5.0
"""Time steps per second at which cameras are compared: successive poses of a person are correlated
anyway (see limits.CORRELATED_POINTS); cost alone."""
_SLOTS = 2
"""Slots of a span, count, within each of which ids count as right: after an exchange of ids at most
half of a span is lost. With one, a clock jump took more than 10 s in 2 of 9 scenes of two cameras,
with two or four in none; four cost more."""
_SLOT_MARGIN_S = 1e-3
"""Seconds by which the slots of the association are longer than the span, so that they contain the
last image."""
_MAX_JOINT_SAMPLES = 4000
"""Joints of all persons in one camera, count; with more people, fewer joints of each are compared.
Cost alone."""
_SCALE_SAMPLES = 4
"""Time steps at which the unit of length is estimated; cost alone, more are strongly correlated."""
_MAX_SCALES = 50
"""Candidates for the unit of length, count; of more, a regular part is tried. Cost alone."""
_MIN_BASELINE_SQUARED = 1e-12
"""Squared distance of two cameras; keeps cameras at one place from dividing by zero."""


@dataclass(frozen=True, slots=True, eq=False)
class SpanObservations:
    """Persons as all cameras observed them at K time steps.

    Attributes
    ----------
    names : tuple of str
        The C cameras.
    rig : Rig
        Poses of the calibration, metres; all on the reference clock.
    metres_per_unit : float
        Size of the unit of length of the calibration, by the size of the people.
    start_s, end_s : float
        Limits of the span, reference clock, seconds since the Unix epoch.
    x : (C, N, K, J, 3) ndarray
        Keypoints of N persons on the plane z = 1; NaN where not observed.
    v : (C, N, K, J, 3) ndarray
        Their time derivative, per second.
    focal : (C, N, K, J) ndarray
        Pixels per unit of x.
    depth_m : (C,) ndarray
        Median distance of the people, by their size; NaN where nobody was observed.
    observed, expected, matched : (C,) ndarray of int
        Numbers of time steps with any person; of these, with a person in view whom at least two
        other cameras observe; and of these, with such a person matched.
    missed : (C,) ndarray of int
        Numbers of time steps with a person in view whom two others observe, but no person at all.
    tentative : (C,) ndarray of bool
        None of its persons matches anybody by the calibration; they are associated with the
        nearest ones, to be accepted if a change of the camera makes them fit.
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
    observed: IntArray
    expected: IntArray
    matched: IntArray
    missed: IntArray
    tentative: BoolArray


def associate_span(
    recording: Recording, calibration: Calibration, *, min_score: float
) -> SpanObservations | None:
    """Associate the persons of a few seconds by a calibration that may be out of date.

    Parameters
    ----------
    recording : Recording
        A few seconds of all cameras; those that the calibration does not have are ignored.
    calibration : Calibration
    min_score : float
        Joints with a lower score are not used.

    Returns
    -------
    SpanObservations or None
        None if fewer than two of the calibration's cameras have images.
    """
    known = {camera.name: camera for camera in calibration.cameras}
    seen = with_lenses_in_force(recording, calibration)
    readable = readable_input(seen, min_score=min_score)
    present = [camera for camera in readable.cameras if camera.name in known]
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
        on_reference_clock(camera, pose, since_epoch_s)
        for camera, pose in zip(
            lift_recording(thinned, skeleton, min_score=min_score, turn=False), poses, strict=True
        )
    ]
    rig = rig_of(poses)
    unit_m = metres_per_unit(lifted, rig)
    rig = replace(rig, t_ref_cam=rig.t_ref_cam * unit_m)
    return _observations(thinned, lifted, rig, unit_m)


def _thinned(camera: CameraRecording) -> CameraRecording:
    """Keep about `RATE_HZ` images per second."""
    stride = max(1, int(1.0 / (RATE_HZ * frame_period(camera.stamps)) + 0.5))
    if stride == 1:
        return camera
    return only_images(camera, np.arange(len(camera.stamps)) % stride == 0)


def on_reference_clock(
    camera: LiftedCamera, pose: CameraCalibration, since_epoch_s: float
) -> LiftedCamera:
    """Return a camera with stamps by the reference clock.

    Parameters
    ----------
    camera : LiftedCamera
    pose : CameraCalibration
        Of the same camera.
    since_epoch_s : float
        Epoch of its recording after that of the calibration, seconds.
    """
    correction_s = clock_correction(
        pose.time_offset_s, pose.clock_skew, camera.stamps + since_epoch_s
    )
    return replace(camera, stamps=camera.stamps + correction_s)


def rig_of(poses: Sequence[CameraCalibration]) -> Rig:
    """Return the rig of calibrated cameras whose stamps are by the reference clock."""
    return Rig(
        cameras=np.arange(len(poses)),
        R_ref_cam=np.stack([pose.R_ref_cam for pose in poses]),
        t_ref_cam=np.stack([pose.t_ref_cam for pose in poses]),
        offset_s=np.zeros(len(poses)),
        support=0.0,
    )


def metres_per_unit(cameras: Sequence[LiftedCamera], rig: Rig) -> float:
    """Return the size of the rig's unit of length that most monocular positions agree with.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        Cameras on the reference clock.
    rig : Rig
        Poses in any unit of length.

    Returns
    -------
    float
        Metres; 1 if nobody is observed by two cameras.
    """
    start, end = time_span(cameras, rig.offset_s)
    times = np.linspace(start, end, _SCALE_SAMPLES + 2)[1:-1]
    bodies = [
        np.stack([_body(camera, track, times) for track in camera.tracks]) @ R.T
        if camera.tracks
        else np.zeros((0, _SCALE_SAMPLES, 3))
        for camera, R in zip(cameras, rig.R_ref_cam, strict=True)
    ]
    differences, baselines = [], []
    for a in range(len(cameras)):
        for b in range(a + 1, len(cameras)):
            difference = bodies[b][None] - bodies[a][:, None]
            both = np.isfinite(difference[..., 0])
            count = both.sum(-1)
            total = np.where(both[..., None], difference, 0.0).sum(2)
            found = total[count > 0] / count[count > 0][:, None]
            differences.append(found)
            baselines.append(np.tile(rig.t_ref_cam[a] - rig.t_ref_cam[b], (len(found), 1)))
    return _most_agreed_scale(np.concatenate(differences), np.concatenate(baselines))


def _most_agreed_scale(D: Float64Array, t: Float64Array) -> float:
    """Return the scale s for which ``D = s t`` (M, 3) holds for most pairs of persons."""
    scale = (D * t).sum(-1) / np.maximum((t * t).sum(-1), _MIN_BASELINE_SQUARED)
    candidates = scale[scale > 0]
    candidates = candidates[:: max(1, len(candidates) // _MAX_SCALES)]
    if not len(candidates):
        return 1.0
    gap = np.linalg.norm(D - candidates[:, None, None] * t, axis=-1)
    agree = gap < SAME_PLACE_M
    best = int(agree.sum(-1).argmax())
    chosen = scale[agree[best]]
    return float(np.median(chosen)) if len(chosen) else float(candidates[best])


def _body(camera: LiftedCamera, track: LiftedTrack, times: Float64Array) -> Float64Array:
    """Return the middle of a person (T, 3) in the optical frame."""
    period = frame_period(camera.stamps)
    return Interpolation(camera.stamps[track.frames], times, period=period)(track.root_cam)


def _observations(
    recording: Recording, cameras: Sequence[LiftedCamera], rig: Rig, unit_m: float
) -> SpanObservations:
    start, end = time_span(cameras, rig.offset_s)
    step_s = (end - start + _SLOT_MARGIN_S) / (_SLOTS * SLOT_SAMPLES)
    found = associate(cameras, rig, step_s=step_s, floor_px=ASSOCIATION_TOLERANCE_PX)
    K = max(2, round((end - start) * SAMPLES_PER_S))
    times = start + (end - start) * (np.arange(K) + 0.5) / K
    x, v, focal, body = _sampled(cameras, found, times)
    counted = _visibility(recording, rig, body)
    tentative = np.array([_reassign(c, rig, body, (x, v, focal)) for c in range(len(cameras))])
    epoch = recording.epoch_ns * 1e-9
    return SpanObservations(
        names=tuple(camera.name for camera in cameras),
        rig=rig,
        metres_per_unit=unit_m,
        start_s=epoch + start,
        end_s=epoch + end,
        x=x,
        v=v,
        focal=focal,
        depth_m=np.array([_median_depth(one) for one in body]),
        **counted,
        tentative=tentative,
    )


def _sampled(
    cameras: Sequence[LiftedCamera], found: Association, times: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """Interpolate all tracks at K times, by person.

    Returns
    -------
    x, v : (C, N, K, J, 3) ndarray
    focal : (C, N, K, J) ndarray
    body : (C, N, K, 3) ndarray
        Mean joint in the optical frame.
    """
    K, C, N = len(times), len(cameras), max(found.n_persons, 1)
    joints, slot = _compared_joints(cameras, N * K), found.slot(times)
    x, v = (np.full((C, N, K, len(joints), 3), np.nan) for _ in range(2))
    focal, body = np.full((C, N, K, len(joints)), np.nan), np.full((C, N, K, 3), np.nan)
    for c, camera in enumerate(cameras):
        period = frame_period(camera.stamps)
        for p, track in enumerate(camera.tracks):
            person = found.person_of[c][p, slot]
            if (person < 0).all():
                continue
            at = Interpolation(camera.stamps[track.frames], times, period=period)
            points = np.concatenate([track.x[:, joints], _ones(track.x[:, joints])], -1)
            places, rates = at.both(points)
            for out, values in (
                (x, places),
                (v, rates),
                (focal, at(track.focal[:, joints])),
                (body, _body(camera, track, times)),
            ):
                here = np.flatnonzero(np.isfinite(values.reshape(K, -1)).any(-1) & (person >= 0))
                out[c, person[here], here] = values[here]
    return x, v, focal, body


def _median_depth(body: Float64Array) -> float:
    """Return the median depth of positions (..., 3) in a camera; NaN without any."""
    depth = body[..., 2][np.isfinite(body[..., 0])]
    return float(np.median(depth)) if len(depth) else np.nan


def _reassign(c: int, rig: Rig, body: Float64Array, arrays: tuple[Float64Array, ...]) -> bool:
    """Re-associate the persons of a camera to the nearest ones, in place, if all are unmatched.

    Returns
    -------
    bool
        Whether any person was re-associated.
    """
    present = np.isfinite(body[..., 0])
    others = np.arange(len(body)) != c
    observed_by_others = present[others].any((0, 2))
    own = np.flatnonzero(present[c].any(-1))
    wanted = np.flatnonzero(observed_by_others)
    if observed_by_others[own].any() or not len(own) or not len(wanted):
        return False
    places = np.einsum("cij,cnkj->cnki", rig.R_ref_cam, body) + rig.t_ref_cam[:, None, None]
    n_others = present[others].sum(0)
    mean = np.where(present[others][..., None], places[others], 0.0).sum(0)
    with np.errstate(invalid="ignore"):
        mean = mean / np.where(n_others > 0, n_others, np.nan)[..., None]
    distance = np.linalg.norm(places[c, own][:, None] - mean[wanted][None], axis=-1)
    n_common = np.isfinite(distance).sum(-1)
    total = np.where(np.isfinite(distance), distance, 0.0).sum(-1)
    common = n_common >= MIN_COMMON_FRACTION * distance.shape[-1]
    cost = np.where(common, total / np.maximum(n_common, 1), MAX_REASSIGNED_M)
    rows, columns = linear_sum_assignment(np.minimum(cost, MAX_REASSIGNED_M))
    near = cost[rows, columns] < MAX_REASSIGNED_M
    for array in arrays:
        moved = array[c, own[rows[near]]].copy()
        array[c] = np.nan
        array[c, wanted[columns[near]]] = moved
    return bool(near.any())


def _ones(points: FloatArray) -> Float64Array:
    return np.where(np.isfinite(points[..., :1]), 1.0, np.nan)


def _compared_joints(cameras: Sequence[LiftedCamera], n_bodies: int) -> IntArray:
    J = next((t.x.shape[1] for c in cameras for t in c.tracks), 1)
    stride = max(1, -(-J * n_bodies // _MAX_JOINT_SAMPLES))
    return np.arange(0, J, stride)


def _visibility(recording: Recording, rig: Rig, body: Float64Array) -> Mapping[str, IntArray]:
    """Count the time steps (C,) in which persons are observed, and in which they should be."""
    C, present = len(body), np.isfinite(body[..., 0])
    places = np.einsum("cij,cnkj->cnki", rig.R_ref_cam, body) + rig.t_ref_cam[:, None, None]
    names = ("observed", "expected", "matched", "missed")
    counted = {name: np.zeros(C, dtype=np.int64) for name in names}
    for c in range(C):
        others = np.arange(C) != c
        n_others = present[others].sum(0)
        mean = np.where(present[others][..., None], places[others], 0.0).sum(0)
        mean /= np.maximum(n_others, 1)[..., None]
        local = (mean - rig.t_ref_cam[c]) @ rig.R_ref_cam[c]
        due = (n_others >= 2) & _in_view(local, recording.cameras[c])
        sees = present[c].any(0)
        counted["observed"][c] = sees.sum()
        counted["missed"][c] = (due.any(0) & ~sees).sum()
        counted["expected"][c] = (due.any(0) & sees).sum()
        counted["matched"][c] = (due.any(0) & (present[c] & (n_others >= 1)).any(0)).sum()
    return counted


def _in_view(points_cam: Float64Array, camera: CameraRecording) -> BoolArray:
    """Whether points (..., 3) project well inside the image."""
    lens = camera.intrinsics
    pixels = project(points_cam, lens)
    x, _ = bearings(pixels, lens)
    size = np.array([lens.width, lens.height])
    with np.errstate(invalid="ignore", divide="ignore"):
        inside = ((pixels > IMAGE_BORDER * size) & (pixels < (1 - IMAGE_BORDER) * size)).all(-1)
        # Far outside, a lens model may lead back into the image.
        in_domain = (
            np.abs(x - points_cam[..., :2] / points_cam[..., 2:]).max(-1) < MAX_LENS_RESIDUAL
        )
    return np.asarray(inside & in_domain & (points_cam[..., 2] > MIN_DISTANCE_M))
