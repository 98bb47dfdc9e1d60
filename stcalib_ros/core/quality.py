"""Is this calibration to be trusted? What each camera rests on, and what is wrong with it.

The adjustment only sees image points. The monocular 3D poses are an independent witness:
their bones must point the way the rotations say, and people must be as far from every camera
as their size says.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.averaging import Rig
from stcalib_ros.core.epipolar import correspondences, sampson
from stcalib_ros.core.geometry import best_rotation, hat, rotation_angle
from stcalib_ros.core.hypotheses import PairHypothesis
from stcalib_ros.core.lift import LiftedCamera
from stcalib_ros.core.rounds import Round, image_points
from stcalib_ros.core.skeleton import Skeleton
from stcalib_ros.core.stba import at_images, persons_of
from stcalib_ros.core.timeline import Interpolation, frame_period
from stcalib_ros.core.types import FloatArray, IntArray, PairResidual

MIN_INLIERS = 400
MAX_ROTATION_STDDEV = 0.015
MAX_CENTRE_STDDEV = 0.10
MAX_OFFSET_STDDEV_FRAMES = 1.0
MAX_BONE_ROTATION = 0.3
DEPTH_RATIO = 1.6
MIN_INLIER_SHARE = 0.55
LONG_ENOUGH_S = 2.5
MIN_EXPLAINED_OF_SHORT = 0.7
MIN_EXPLAINED = 0.5
SURE_ROTATION_STDDEV = 0.005
SURE_BONE_ROTATION = 0.1
SURE_OFFSET_CONTRAST = 3.0
MIN_OFFSET_CONTRAST = 1.2
_FAR_FRAMES = 3
_CONTRAST_SCALE = 2.0
_CONTRAST_JOINTS = 5
_MIN_CONTRAST_POINTS = 60
_BONE_FRAMES = 400


@dataclass(frozen=True, slots=True, eq=False)
class CameraEvidence:
    """What the pose of one camera rests on.

    Attributes
    ----------
    inliers : int
        Image points that fit.
    inlier_share : float
        Of the image points of associated persons.
    explained : float
        Inliers over all image points that it has, of whomever. Two cameras that share nobody
        still find a pose at which somebody's steps agree for a while.
    shared_s : float
        Time for which it sees somebody together with another camera, summed over persons. Of a
        second or two, some other stretch of steps fits as well sooner or later.
    rotation_stddev : float
        Largest standard deviation of its rotation about any axis, rad.
    centre_stddev : float
        The same of its centre, over its usual distance from the people.
    offset_stddev_frames : float
    bone_rotation : float
        Angle between its rotation and the one that the monocular poses ask for, rad; the
        smallest over the cameras it shares people with.
    depth_ratio : float
        Distance of people by triangulation over distance by their size, relative to the
        other cameras.
    offset_contrast : float
        How many times worse the best other offset, three frames or more away, fits.
    """

    inliers: int
    inlier_share: float
    explained: float
    shared_s: float
    rotation_stddev: float
    centre_stddev: float
    offset_stddev_frames: float
    bone_rotation: float
    depth_ratio: float
    offset_contrast: float

    def complaint(self) -> str | None:
        """The first thing that is wrong, with its number and what would help; None if nothing."""
        return self._unshared() or self._mixed_up() or self._uncertain()

    def _unshared(self) -> str | None:
        if self.inliers < MIN_INLIERS:
            return (
                f"only {self.inliers} of its image points fit, {MIN_INLIERS} are needed: "
                "have people walk where it and the others see them"
            )
        if self.inlier_share < MIN_INLIER_SHARE:
            return (
                f"only {100 * self.inlier_share:.0f} % of its image points fit: check its "
                "intrinsics, and that its key points belong to the image CameraInfo describes"
            )
        sure = (
            self.rotation_stddev < SURE_ROTATION_STDDEV
            and self.bone_rotation < SURE_BONE_ROTATION
            and self.offset_contrast > SURE_OFFSET_CONTRAST
        )
        if self.explained < MIN_EXPLAINED and not sure:
            return (
                f"only {100 * self.explained:.0f} % of all that it sees agrees with the others: "
                "it may show other people; let the same people walk where it and the others see "
                "them, and record longer"
            )
        if self.shared_s < LONG_ENOUGH_S and self.explained < MIN_EXPLAINED_OF_SHORT:
            return (
                f"it shares only {self.shared_s:.1f} s of somebody's motion with the others, and "
                f"only {100 * self.explained:.0f} % of all that it sees agrees with them: that may "
                "be chance; let people stay in view of two cameras for longer"
            )
        return None

    def _mixed_up(self) -> str | None:
        if not self.bone_rotation < MAX_BONE_ROTATION:
            return (
                f"the bones of its 3D poses disagree with its rotation by "
                f"{np.degrees(self.bone_rotation):.0f} degrees: persons may be mixed up; "
                "record a longer clip with people who move differently"
            )
        if not 1 / DEPTH_RATIO < self.depth_ratio < DEPTH_RATIO:
            return (
                f"people would be {self.depth_ratio:.1f} times as far from it as their size says: "
                "persons may be mixed up; record a longer clip with people who move differently"
            )
        return None

    def _uncertain(self) -> str | None:
        if not self.rotation_stddev < MAX_ROTATION_STDDEV:
            return (
                f"its rotation is uncertain by {np.degrees(self.rotation_stddev):.1f} degrees: "
                "it shares too little with the others; let people walk across more of its view"
            )
        if not self.centre_stddev < MAX_CENTRE_STDDEV:
            return (
                f"its position is uncertain by {100 * self.centre_stddev:.0f} % of its distance "
                "from the people: let them walk across more of its view"
            )
        if not self.offset_contrast > MIN_OFFSET_CONTRAST:
            return (
                "its clock offset cannot be told: one that is three frames or more away fits as "
                f"well (error {self.offset_contrast:.2f} times as large, {MIN_OFFSET_CONTRAST:.2f} "
                "needed); people have to move more, and not in the same rhythm all the time"
            )
        if not self.offset_stddev_frames < MAX_OFFSET_STDDEV_FRAMES:
            return (
                f"its clock offset is uncertain by {self.offset_stddev_frames:.1f} frames: "
                "people have to move faster, or the clip has to be longer"
            )
        return None


def evidence(
    cameras: Sequence[LiftedCamera],
    skeleton: Skeleton,
    last: Round,
    covariance: FloatArray,
    *,
    offset_range_s: float,
) -> tuple[CameraEvidence, ...]:
    """Evidence on every camera of the rig, the reference included.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    skeleton : Skeleton
    last : Round
    covariance : (7 C, 7 C) ndarray
        As `covariance.pose_covariance` gives it.
    offset_range_s : float
        Other offsets are tried within plus and minus this.
    """
    C, frame_s = len(last.rig.cameras), last.observations.step_s
    asked = not last.rig.synchronised
    contrast = offset_contrasts(last, max_shift=int(np.ceil(offset_range_s / frame_s)))
    used, seen = last.state.used.sum((0, 2)), last.observations.seen.sum((0, 2))
    shared = last.state.used.any(2).sum(0)
    total = image_points([cameras[c] for c in last.rig.cameras])
    reach = usual_distances(last)
    turned = bone_rotations(cameras, skeleton, last)
    depth = depth_ratios(cameras, last)
    depth /= np.nanmedian(depth) if np.isfinite(depth).any() else 1.0
    found = []
    for c in range(C):
        block = covariance[7 * c : 7 * c + 7, 7 * c : 7 * c + 7]
        worst = [
            float(np.sqrt(max(np.linalg.eigvalsh(block[i : i + 3, i : i + 3])[-1], 0.0)))
            for i in (0, 3)
        ]
        found.append(
            CameraEvidence(
                inliers=int(used[c]),
                inlier_share=float(used[c] / max(int(seen[c]), 1)),
                explained=float(used[c] / max(int(total[c]), 1)),
                shared_s=float(shared[c]) * frame_s,
                rotation_stddev=worst[1],
                centre_stddev=worst[0] / float(reach[c]),
                offset_stddev_frames=float(np.sqrt(max(block[6, 6], 0.0))) / frame_s,
                bone_rotation=float(np.nanmin(turned[c], initial=np.inf)),
                depth_ratio=float(depth[c]),
                offset_contrast=float(contrast[c]) if asked and c else float("inf"),
            )
        )
    return tuple(found)


def offset_contrasts(last: Round, *, max_shift: int) -> FloatArray:
    """Error (C,) of each camera's best other offset over its error at the offset found.

    The error is the epipolar distance to the points of the other cameras, shifted by whole
    knots: it owes nothing to the triangulated points. Where nobody moves, all shifts fit
    alike and the contrast is one; where too few points are common it is zero.
    """
    C = len(last.rig.cameras)
    far = [*range(_FAR_FRAMES, 3 * _FAR_FRAMES), *range(3 * _FAR_FRAMES, max_shift + 1, 3)]
    shifts = np.array([*(-d for d in reversed(far)), 0, *far])
    scale = _CONTRAST_SCALE * max(last.association.typical_px, 1.0)
    total, count = np.zeros((C, len(shifts))), np.zeros((C, len(shifts)))
    for path in _image_paths(last):
        for a in range(C):
            for b in range(a + 1, C):
                h = _hypothesis(last.rig, a, b, ())
                E = hat(h.t_a_b / np.linalg.norm(h.t_a_b)) @ h.R_a_b
                cost, n = _shifted_costs(E, path[a], path[b], shifts, scale)
                for c, order in ((a, slice(None, None, -1)), (b, slice(None))):
                    total[c] += cost[order]
                    count[c] += n[order]
    known = count >= _MIN_CONTRAST_POINTS
    mean = np.where(known, total / np.maximum(count, 1), np.inf)
    found = np.flatnonzero(shifts == 0)[0]
    others = np.where(shifts != 0, mean, np.inf).min(1)
    here = np.where(known[:, found], np.maximum(mean[:, found], 1e-12), np.inf)
    return np.where(known[:, found], others, 0.0) / here


def _shifted_costs(
    E: FloatArray, a: FloatArray, b: FloatArray, shifts: IntArray, scale: float
) -> tuple[FloatArray, FloatArray]:
    """Robust epipolar cost of knots k of a with knots k + shift of b, and how many there are."""
    n = len(a)
    cost, count = np.zeros(len(shifts)), np.zeros(len(shifts))
    line_a, line_b = b[..., :3] @ E.T, a[..., :3] @ E
    steep_a, steep_b = ((line[..., :2] ** 2).sum(-1) for line in (line_a, line_b))
    focal_a, focal_b = a[..., 3] / scale, b[..., 3] / scale
    for k, d in enumerate(shifts):
        if n - abs(d) > 0:
            here, there = slice(max(0, -d), n - max(0, d)), slice(max(0, d), n - max(0, -d))
            distance = np.einsum("kji,kji->kj", a[here, :, :3], line_a[there])
            steepness = np.maximum(steep_b[here] + steep_a[there], 1e-18)
            squared = distance**2 / steepness * focal_a[here] * focal_b[there]
            good = squared[np.isfinite(squared)]
            cost[k], count[k] = np.log1p(good).sum(), len(good)
    return cost, count


def _image_paths(last: Round) -> Iterator[FloatArray]:
    """Points (C, K, J, 4) of one person after the other: x, y, 1 on the plane z = 1 and focal.

    Brought to the time of their knots by the motion model; a few joints; NaN where not used.
    """
    o, state = last.observations, last.state
    joints = slice(None, None, max(1, o.x.shape[2] // _CONTRAST_JOINTS))
    R = np.swapaxes(state.R_cam_ref, -1, -2)
    for rows in persons_of(o):
        X = (state.X[rows][:, None, joints], at_images(o, state, rows)[:, :, joints])
        at_knot, at_image = (one @ R + state.t_cam_ref[:, None] for one in X)
        with np.errstate(divide="ignore", invalid="ignore"):
            motion = at_image[..., :2] / at_image[..., 2:] - at_knot[..., :2] / at_knot[..., 2:]
        points = np.concatenate(
            [
                o.x[rows, :, joints] - motion,
                np.ones_like(motion[..., :1]),
                o.focal[rows, :, joints, None],
            ],
            -1,
        )
        points[~state.used[rows, :, joints]] = np.nan
        knots = o.knot[rows] - o.knot[rows][0]
        path = np.full((points.shape[1], int(knots[-1]) + 1, *points.shape[2:]), np.nan)
        path[:, knots] = np.moveaxis(points, 1, 0)
        yield path


def matches_of(last: Round, a: int, b: int) -> tuple[tuple[int, int], ...]:
    """Tracks of two cameras (positions in the rig) that are one person in some slot."""
    person_a, person_b = last.association.person_of[a], last.association.person_of[b]
    same = (person_a[:, None] == person_b[None]) & (person_a[:, None] >= 0)
    return tuple((int(p), int(q)) for p, q in np.argwhere(same.any(-1)))


def _hypothesis(rig: Rig, a: int, b: int, matches: tuple[tuple[int, int], ...]) -> PairHypothesis:
    R_a = rig.R_ref_cam[a]
    return PairHypothesis(
        int(rig.cameras[a]),
        int(rig.cameras[b]),
        R_a.T @ rig.R_ref_cam[b],
        R_a.T @ (rig.t_ref_cam[b] - rig.t_ref_cam[a]),
        float(rig.offset_s[a] - rig.offset_s[b]),
        matches,
        0.0,
    )


def bone_rotations(cameras: Sequence[LiftedCamera], skeleton: Skeleton, last: Round) -> FloatArray:
    """Angle (C, C) between relative rotations of the rig and of the bones; NaN without matches."""
    C = len(last.rig.cameras)
    angle = np.full((C, C), np.nan)
    for a in range(C):
        for b in range(a + 1, C):
            v_a, v_b = _matched_bones(cameras, skeleton, last, a, b)
            if len(v_a) >= 100:
                R_a_b = last.rig.R_ref_cam[a].T @ last.rig.R_ref_cam[b]
                by_bones = best_rotation(v_a.T @ v_b)
                angle[a, b] = angle[b, a] = float(rotation_angle(R_a_b.T @ by_bones))
    return angle


def _matched_bones(
    cameras: Sequence[LiftedCamera], skeleton: Skeleton, last: Round, a: int, b: int
) -> tuple[FloatArray, FloatArray]:
    """Bones (M, 3), (M, 3) of the same moments in the two optical frames, metres; thinned."""
    rig = last.rig
    cam_a, cam_b = cameras[rig.cameras[a]], cameras[rig.cameras[b]]
    lag = rig.offset_s[a] - rig.offset_s[b]
    period = frame_period(cam_b.stamps)
    pairs_a, pairs_b = [np.zeros((0, 3))], [np.zeros((0, 3))]
    matches = matches_of(last, a, b)
    stride = max(1, sum(len(cam_a.tracks[p].frames) for p, _ in matches) // _BONE_FRAMES)
    for p, q in matches:
        track_a, track_b = cam_a.tracks[p], cam_b.tracks[q]
        times = cam_a.stamps[track_a.frames[::stride]]
        at = Interpolation(cam_b.stamps[track_b.frames], times + lag, period=period)
        slot = last.association.slot(times + rig.offset_s[a])
        same = last.association.person_of[a][p][slot] == last.association.person_of[b][q][slot]
        v_a = _bones(track_a.joints_cam[::stride], skeleton)
        v_b = _bones(at(track_b.joints_cam), skeleton)
        good = np.isfinite(v_a + v_b).all(-1) & same[:, None]
        pairs_a.append(v_a[good])
        pairs_b.append(v_b[good])
    return np.concatenate(pairs_a), np.concatenate(pairs_b)


def _bones(joints: FloatArray, skeleton: Skeleton) -> FloatArray:
    known = np.isfinite(joints[..., 0])
    vectors = np.einsum("dj,fjk->fdk", skeleton.directions, np.nan_to_num(joints), optimize=True)
    missing = (skeleton.directions != 0).astype(float) @ (~known).T.astype(float)
    return np.asarray(np.where((missing.T == 0)[..., None], vectors, np.nan))


def usual_distances(last: Round) -> FloatArray:
    """Median distance (C,) of the people from each camera along its axis, in the rig's unit."""
    state = last.state
    Z = state.X @ state.R_cam_ref[:, 2].T + state.t_cam_ref[:, 2]
    seen = state.used.transpose(0, 2, 1)
    return np.array(
        [
            np.median(Z[..., c][seen[..., c]]) if seen[..., c].any() else np.nan
            for c in range(Z.shape[-1])
        ]
    )


def depth_ratios(cameras: Sequence[LiftedCamera], last: Round) -> FloatArray:
    """Triangulated over monocular distance of people from each camera (C,); NaN if unknown."""
    o, state = last.observations, last.state
    ratio = np.full(len(last.rig.cameras), np.nan)
    for c, index in enumerate(last.rig.cameras):
        rows = np.flatnonzero((o.track[:, c] >= 0) & state.used[:, c].any(-1))
        rows = rows[:: max(1, len(rows) // 400)]
        Z = state.X[rows] @ state.R_cam_ref[c][2] + state.t_cam_ref[c][2]
        lifted = _lifted_depths(cameras[index], o.track[rows, c], _times(last, rows, c))
        both = state.used[rows, c] & np.isfinite(lifted) & (lifted > 0)
        if both.any():
            ratio[c] = float(np.median(Z[both] / lifted[both]))
    return ratio


def depth_scale(cameras: Sequence[LiftedCamera], last: Round) -> float:
    """Factor from the unit of the adjustment to metres, by the size of the people."""
    ratio = depth_ratios(cameras, last)
    return 1.0 / float(np.nanmedian(ratio)) if np.isfinite(ratio).any() else 1.0


def _times(last: Round, rows: IntArray, c: int) -> FloatArray:
    """Times of images by the clock of their camera."""
    o = last.observations
    reference = o.start_s + o.knot[rows] * o.step_s + o.phi[rows, c]
    return np.asarray(reference - last.rig.offset_s[c] + last.state.shift_s[c])


def _lifted_depths(camera: LiftedCamera, tracks: IntArray, times: FloatArray) -> FloatArray:
    J = camera.tracks[0].x.shape[1]
    depth = np.full((len(tracks), J), np.nan)
    for p in np.unique(tracks):
        track = camera.tracks[p]
        mine = np.flatnonzero(tracks == p)
        nearest = np.searchsorted(camera.stamps[track.frames], times[mine] - 1e-6)
        depth[mine] = track.joints_cam[np.minimum(nearest, len(track.frames) - 1), :, 2]
    return depth


def pair_residuals(
    cameras: Sequence[LiftedCamera], skeleton: Skeleton, last: Round
) -> tuple[PairResidual, ...]:
    """How well every two cameras with common persons agree."""
    found = []
    rig = last.rig
    for a in range(len(rig.cameras)):
        for b in range(a + 1, len(rig.cameras)):
            matches = matches_of(last, a, b)
            v_a, v_b = _matched_bones(cameras, skeleton, last, a, b)
            if not len(v_a):
                continue
            h = _hypothesis(rig, a, b, matches)
            persons = set(last.association.person_of[a].ravel().tolist()) & set(
                last.association.person_of[b].ravel().tolist()
            )
            found.append(
                PairResidual(
                    cameras[h.a].name,
                    cameras[h.b].name,
                    len(persons - {-1}),
                    _median_angle(v_a, v_b @ h.R_a_b.T),
                    _epipolar_rms(cameras, h),
                )
            )
    return tuple(found)


def _median_angle(v: FloatArray, w: FloatArray) -> float:
    cosine = (v * w).sum(-1) / np.maximum(
        np.linalg.norm(v, axis=-1) * np.linalg.norm(w, axis=-1), 1e-12
    )
    return float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _epipolar_rms(cameras: Sequence[LiftedCamera], h: PairHypothesis) -> float:
    """Sampson distance, px, of the inliers (three times the median)."""
    c = correspondences(cameras, h)
    if not len(c.x_a):
        return float("nan")
    r = np.abs(sampson(hat(h.t_a_b / np.linalg.norm(h.t_a_b)) @ h.R_a_b, c.x_a, c.x_b) * c.focal)
    inliers = r[r <= max(3.0 * float(np.median(r)), 1e-12)]
    return float(np.sqrt((inliers**2).mean()))
