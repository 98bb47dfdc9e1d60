"""Agreement of cameras with the monocular 3D poses and with one another, pair by pair."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.geometry.alignment import best_rotation
from stcalib_ros.core.geometry.epipolar import sampson
from stcalib_ros.core.geometry.interpolation import Interpolation, frame_period
from stcalib_ros.core.geometry.so3 import hat, rotation_angle
from stcalib_ros.core.model.arrays import Float64Array, FloatArray, IntArray
from stcalib_ros.core.model.calibration import PairResidual
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack
from stcalib_ros.core.model.relative_pose import relative_pose
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.validation.thresholds import MIN_BONE_PAIRS

_MAX_FRAMES = 400
"""Frames of a camera, or of a pair of cameras, that are compared; purely numerical: more frames
change medians by less than their scatter."""
_INLIER_FACTOR = 3.0
"""Times the median Sampson distance. Residuals beyond it do not count in the root mean square of a
pair, which is reported and decides nothing."""


def matches_of(last: Iteration, a: int, b: int) -> tuple[tuple[int, int], ...]:
    """Return the tracks of two cameras (positions in the rig) that are one person at some time."""
    person_a, person_b = last.association.person_of[a], last.association.person_of[b]
    found: set[tuple[int, int]] = set()
    for here, there in zip(person_a.T, person_b.T, strict=True):
        known_a, known_b = np.flatnonzero(here >= 0), np.flatnonzero(there >= 0)
        same = np.argwhere(here[known_a, None] == there[known_b])
        found.update(zip(known_a[same[:, 0]].tolist(), known_b[same[:, 1]].tolist(), strict=True))
    return tuple(sorted(found))


def bone_rotations(
    cameras: Sequence[LiftedCamera], skeleton: Skeleton, last: Iteration
) -> Float64Array:
    """Compare relative rotations of the rig with those of the bones of the monocular 3D poses.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    skeleton : Skeleton
    last : Iteration

    Returns
    -------
    (C, C) ndarray
        Angle between the two, rad; NaN where too few bones are common.

    References
    ----------
    W. Kabsch, "A solution for the best rotation to relate two sets of vectors", Acta
    Crystallographica A32, 1976.
    """
    C = len(last.rig.cameras)
    angle = np.full((C, C), np.nan)
    for a in range(C):
        for b in range(a + 1, C):
            v_a, v_b = _matched_bones(cameras, skeleton, last, a, b)
            if len(v_a) >= MIN_BONE_PAIRS:
                R_a_b = last.rig.R_ref_cam[a].T @ last.rig.R_ref_cam[b]
                by_bones = best_rotation(v_a.T @ v_b)
                angle[a, b] = angle[b, a] = float(rotation_angle(R_a_b.T @ by_bones))
    return angle


def _matched_bones(
    cameras: Sequence[LiftedCamera], skeleton: Skeleton, last: Iteration, a: int, b: int
) -> tuple[Float64Array, Float64Array]:
    """Bones (M, 3), (M, 3) at common times in the two optical frames, m; of some frames only."""
    pairs_a, pairs_b = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for track_a, rows, track_b, at in _common_frames(cameras, last, a, b):
        v_a = _bones(track_a.joints_cam[rows], skeleton)
        v_b = _bones(at(track_b.joints_cam), skeleton)
        good = np.isfinite(v_a + v_b).all(-1)
        pairs_a.append(v_a[good])
        pairs_b.append(v_b[good])
    return np.concatenate(pairs_a), np.concatenate(pairs_b)


def _common_frames(
    cameras: Sequence[LiftedCamera], last: Iteration, a: int, b: int
) -> Iterator[tuple[LiftedTrack, IntArray, LiftedTrack, Interpolation]]:
    """Yield a track of a, rows of it, and the track of b that is the same person at these times.

    Which track is which person is looked up slot by slot: trackers exchange ids, and two tracks
    that are one person at some time are two persons at another. Of many frames, a regular part.
    """
    rig, known = last.rig, last.association
    cam_a, cam_b = cameras[rig.cameras[a]], cameras[rig.cameras[b]]
    lag, period = rig.offset_s[a] - rig.offset_s[b], frame_period(cam_b.stamps)
    common = []
    for p, q in matches_of(last, a, b):
        slot = known.slot(cam_a.stamps[cam_a.tracks[p].frames] + rig.offset_s[a])
        person = known.person_of[a][p][slot]
        rows = np.flatnonzero((person >= 0) & (person == known.person_of[b][q][slot]))
        common.append((cam_a.tracks[p], rows, cam_b.tracks[q]))
    stride = max(1, sum(len(rows) for _, rows, _ in common) // _MAX_FRAMES)
    for track_a, every, track_b in common:
        rows = every[::stride]
        times = cam_a.stamps[track_a.frames[rows]] + lag
        yield (
            track_a,
            rows,
            track_b,
            Interpolation(cam_b.stamps[track_b.frames], times, period=period),
        )


def _bones(joints: FloatArray, skeleton: Skeleton) -> Float64Array:
    known = np.isfinite(joints[..., 0])
    vectors = np.einsum("dj,fjk->fdk", skeleton.directions, np.nan_to_num(joints), optimize=True)
    missing = (skeleton.directions != 0).astype(float) @ (~known).T.astype(float)
    return np.asarray(np.where((missing.T == 0)[..., None], vectors, np.nan))


def usual_distances(last: Iteration) -> Float64Array:
    """Return the median depth (C,) of the people in each camera, in the unit of the adjustment."""
    state = last.state
    Z = state.X @ state.R_cam_ref[:, 2].T + state.t_cam_ref[:, 2]
    inlier = state.inlier.transpose(0, 2, 1)
    return np.array(
        [
            np.median(Z[..., c][inlier[..., c]]) if inlier[..., c].any() else np.nan
            for c in range(Z.shape[-1])
        ]
    )


def depth_ratios(cameras: Sequence[LiftedCamera], last: Iteration) -> Float64Array:
    """Compare triangulated depths of people with those of their monocular 3D poses.

    Where there is no 3D pose, all joints are as far away as the size of the limbs says.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    last : Iteration

    Returns
    -------
    (C,) ndarray
        Median of the triangulated over the monocular depth of all inliers of a camera, in the unit
        of the adjustment over metres; NaN without inliers.
    """
    obs, state = last.observations, last.state
    ratio = np.full(len(last.rig.cameras), np.nan)
    for c, index in enumerate(last.rig.cameras):
        rows = np.flatnonzero((obs.track[:, c] >= 0) & state.inlier[:, c].any(-1))
        rows = rows[:: max(1, len(rows) // _MAX_FRAMES)]
        Z = state.X[rows] @ state.R_cam_ref[c][2] + state.t_cam_ref[c][2]
        lifted = _lifted_depths(cameras[index], obs.track[rows, c], _times(last, rows, c))
        both = state.inlier[rows, c] & np.isfinite(lifted) & (lifted > 0)
        if both.any():
            ratio[c] = float(np.median(Z[both] / lifted[both]))
    return ratio


def depth_scale(cameras: Sequence[LiftedCamera], last: Iteration) -> float:
    """Return the factor from the unit of the adjustment to metres, by the size of the people."""
    ratio = depth_ratios(cameras, last)
    return 1.0 / float(np.nanmedian(ratio)) if np.isfinite(ratio).any() else 1.0


def _times(last: Iteration, rows: IntArray, c: int) -> Float64Array:
    """Times of images by the clock of their camera, s."""
    obs = last.observations
    reference = obs.start_s + obs.time_bin[rows] * obs.step_s + obs.phi[rows, c]
    return np.asarray(reference - last.rig.offset_s[c] + last.state.shift_s[c])


def _lifted_depths(camera: LiftedCamera, tracks: IntArray, times: Float64Array) -> Float64Array:
    """Monocular depths (N, J) of tracks (N,) in the frames nearest to some times (N,), m."""
    J = camera.tracks[0].x.shape[1]
    depth = np.full((len(tracks), J), np.nan)
    for p in np.unique(tracks):
        track = camera.tracks[p]
        rows, stamps = np.flatnonzero(tracks == p), camera.stamps[track.frames]
        nearest = np.searchsorted(0.5 * (stamps[1:] + stamps[:-1]), times[rows])
        poses, roots = track.joints_cam[nearest, :, 2], track.root_cam[nearest, 2:]
        depth[rows] = np.where(np.isfinite(poses).any(1, keepdims=True), poses, roots)
    return depth


def pair_residuals(
    cameras: Sequence[LiftedCamera], skeleton: Skeleton, last: Iteration
) -> tuple[PairResidual, ...]:
    """Measure how well every two cameras with common persons agree.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    skeleton : Skeleton
    last : Iteration
    """
    found = []
    rig = last.rig
    for a in range(len(rig.cameras)):
        for b in range(a + 1, len(rig.cameras)):
            if not (n_persons := _n_common_persons(last, a, b)):
                continue
            v_a, v_b = _matched_bones(cameras, skeleton, last, a, b)
            pose = relative_pose(rig, a, b)
            found.append(
                PairResidual(
                    cameras[pose.a].name,
                    cameras[pose.b].name,
                    n_persons,
                    _median_angle(v_a, v_b @ pose.R_a_b.T),
                    _epipolar_rms(_epipolar_px(cameras, last, a, b)),
                )
            )
    return tuple(found)


def _n_common_persons(last: Iteration, a: int, b: int) -> int:
    """Count the persons that two cameras observe at the same time, slot by slot."""
    person_a, person_b = last.association.person_of[a], last.association.person_of[b]
    same = (person_a[:, None] == person_b[None]) & (person_a[:, None] >= 0)
    return len(np.unique(np.broadcast_to(person_a[:, None], same.shape)[same]))


def _median_angle(v: Float64Array, w: Float64Array) -> float:
    """Median angle between two lists of vectors (M, 3), rad; NaN without any."""
    if not len(v):
        return float("nan")
    cosine = (v * w).sum(-1) / np.maximum(
        np.linalg.norm(v, axis=-1) * np.linalg.norm(w, axis=-1), 1e-12
    )
    return float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _epipolar_px(cameras: Sequence[LiftedCamera], last: Iteration, a: int, b: int) -> Float64Array:
    """Sampson distances (M,) of the keypoints of the same persons at common times, px."""
    pose = relative_pose(last.rig, a, b)
    E = hat(pose.t_a_b / np.linalg.norm(pose.t_a_b)) @ pose.R_a_b
    distances = [np.zeros(0)]
    for track_a, rows, track_b, at in _common_frames(cameras, last, a, b):
        x_a, x_b = (
            np.concatenate([x, np.ones_like(x[..., :1])], -1)
            for x in (track_a.x[rows], at(track_b.x))
        )
        px = np.abs(sampson(E, x_a, x_b)) * np.sqrt(track_a.focal[rows] * at(track_b.focal))
        distances.append(px[np.isfinite(px)])
    return np.concatenate(distances)


def _epipolar_rms(distances: Float64Array) -> float:
    """Root mean square of the inliers of distances (M,); NaN without any."""
    if not len(distances):
        return float("nan")
    inliers = distances[distances <= max(_INLIER_FACTOR * float(np.median(distances)), 1e-12)]
    return float(np.sqrt((inliers**2).mean()))
