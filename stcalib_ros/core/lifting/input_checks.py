"""What must hold before anything is computed: cameras, clocks, images, motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.graphs import components
from stcalib_ros.core.geometry.interpolation import frame_period
from stcalib_ros.core.lifting.keypoint_checks import require_shapes
from stcalib_ros.core.lifting.limits import MIN_CAMERAS, MIN_MOVEMENT, PERIOD_SLACK
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Insufficient, Status, UncalibratedCamera
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.model.rejection import Rejection, RejectionReason
from stcalib_ros.core.options import Options

_SMOOTHING_S = 0.25
"""Seconds over which keypoints are averaged, so that noise from image to image is no movement."""


@dataclass(frozen=True, slots=True)
class Selection:
    """Cameras that can be compared, and those that are rejected before anything is computed.

    Attributes
    ----------
    cameras : tuple of int
        Indices of the former, the reference first.
    rejected : tuple of UncalibratedCamera
    """

    cameras: tuple[int, ...]
    rejected: tuple[UncalibratedCamera, ...]


def require_usable(recording: Recording, options: Options) -> int:
    """Check a recording against the options.

    Returns
    -------
    int
        Index of the reference camera.

    Raises
    ------
    InputError
        The reference, a known distance, a line delay, an array or the method cannot be used with
        this recording.
    """
    reference = require_reference(recording, options)
    require_shapes(recording)
    require_known_cameras(recording, options)
    require_line_times(recording)
    require_poses(recording, options)
    return reference


def require_reference(recording: Recording, options: Options) -> int:
    """Return the index of the reference camera.

    Raises
    ------
    InputError
        There is no camera, two have one name, or the reference is not among the cameras.
    """
    names = [camera.name for camera in recording.cameras]
    if not names:
        raise InputError("no camera in the recording: at least two with person poses are needed")
    if twice := sorted({n for n in names if names.count(n) > 1}):
        raise InputError(f"two cameras are called {twice[0]!r}: give every camera its own name")
    if options.reference is None:
        return 0
    if options.reference not in names:
        raise InputError(
            f"reference camera {options.reference!r} is not in the recording: "
            f"there are {', '.join(names) or 'none'}"
        )
    return names.index(options.reference)


def require_known_cameras(recording: Recording, options: Options) -> None:
    """Check that the cameras of known distances are in the recording.

    Raises
    ------
    InputError
        One is not in the recording.
    """
    names = [camera.name for camera in recording.cameras]
    for distance in options.scale.distances:
        if unknown := [name for name in distance.names if name not in names]:
            raise InputError(
                f"scale.distances: camera {unknown[0]!r} is not in the recording: "
                f"there are {', '.join(names)}"
            )


def require_line_times(recording: Recording) -> None:
    """Check that the images of all cameras are read before the next ones begin.

    Raises
    ------
    InputError
        A line time is negative, not finite, or too long.
    """
    for camera in recording.cameras:
        line_s = camera.line_time_s
        if not (np.isfinite(line_s) and line_s >= 0.0):
            raise InputError(
                f"camera {camera.name}: line_time_s must be at least 0 (seconds per image row), "
                f"got {line_s}"
            )
        height, period = camera.intrinsics.height, frame_period(camera.stamps)
        if line_s * height > PERIOD_SLACK * period:
            raise InputError(
                f"camera {camera.name}: line_time_s {line_s:g} makes {1e3 * line_s * height:.3g} "
                f"ms for {height} rows, but its images are {1e3 * period:.3g} ms apart: give the "
                "seconds from one row to the next"
            )


def require_poses(recording: Recording, options: Options) -> None:
    """Check that there are 3D poses where the method needs them.

    Raises
    ------
    InputError
        A camera sees people, but has none.
    """
    if options.registration.method != "vmf":
        return
    without = [c.name for c in recording.cameras if c.tracks and not c.has_3d_poses]
    if without:
        raise InputError(
            f"registration.method vmf needs 3D poses, and there are none of {', '.join(without)}: "
            "use the default method, which keypoints are enough for"
        )


def select_cameras(
    cameras: Sequence[LiftedCamera],
    first: int,
    options: Options,
    faults: Mapping[str, Rejection] | None = None,
) -> Selection:
    """Select the cameras that observe people and whose clocks can overlap.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
    first : int
        Index of the reference camera.
    options : Options
    faults : mapping of str to Rejection, optional
        Why cameras observe nobody, by name, where that is known.

    Raises
    ------
    Insufficient
        Fewer than two are left.
    """
    order = [first, *(i for i in range(len(cameras)) if i != first)]
    seeing = [i for i in order if cameras[i].tracks]
    blind = [cameras[i].name for i in order if i not in seeing]
    known = faults or {}
    rejected = [
        UncalibratedCamera(name, known.get(name, Rejection(RejectionReason.NO_PERSONS, (name,))))
        for name in blind
    ]
    groups = _overlapping(cameras, seeing, options)
    kept = max(groups, key=len, default=[])
    for group in groups:
        if group is not kept:
            rejected += [_clock_rejection(cameras, i, kept, options) for i in group]
    if len(kept) < MIN_CAMERAS:
        few = Rejection(
            RejectionReason.TOO_FEW_CAMERAS,
            measured=float(len(kept)),
            limit=float(MIN_CAMERAS),
            unit="cameras",
        )
        raise Insufficient(Status.INSUFFICIENT_DATA, few, rejected)
    _require_motion([cameras[i] for i in kept])
    return Selection(tuple(kept), tuple(rejected))


def _overlapping(
    cameras: Sequence[LiftedCamera], members: Sequence[int], options: Options
) -> list[list[int]]:
    """Return groups of cameras with enough temporal overlap, in the given order."""
    tied = np.array(
        [
            [
                _common_frames(cameras[i], cameras[j], options) >= options.min_common_frames
                for j in members
            ]
            for i in members
        ]
    ).reshape(len(members), len(members))
    return [[members[k] for k in group] for group in components(tied)]


def _common_frames(a: LiftedCamera, b: LiftedCamera, options: Options) -> float:
    """Return how many images two cameras have in common at best, within the range of offsets."""
    slack = 2.0 * options.offset_range_s
    overlap = min(a.stamps[-1], b.stamps[-1] + slack) - max(a.stamps[0], b.stamps[0] - slack)
    longest = min(a.stamps[-1] - a.stamps[0], b.stamps[-1] - b.stamps[0])
    period = max(frame_period(a.stamps), frame_period(b.stamps))
    return min(overlap, longest) / period + 1.0 if np.isfinite(period) else 1.0


def _clock_rejection(
    cameras: Sequence[LiftedCamera], i: int, kept: Sequence[int], options: Options
) -> UncalibratedCamera:
    camera = cameras[i]
    begin_s, end_s = float(camera.stamps[0]), float(camera.stamps[-1])
    others_begin_s = min(float(cameras[j].stamps[0]) for j in kept)
    others_end_s = max(float(cameras[j].stamps[-1]) for j in kept)
    gap_s = max(begin_s - others_end_s, others_begin_s - end_s)
    others = tuple(cameras[j].name for j in kept)
    if gap_s > 2.0 * options.offset_range_s:
        rejection = Rejection(
            RejectionReason.CLOCK_EPOCH_DIFFERS,
            (camera.name,),
            gap_s,
            2.0 * options.offset_range_s,
            "s",
            others,
            {
                "begin_s": begin_s,
                "end_s": end_s,
                "others_begin_s": others_begin_s,
                "others_end_s": others_end_s,
            },
        )
    else:
        rejection = Rejection(
            RejectionReason.NO_TEMPORAL_OVERLAP,
            (camera.name,),
            max(_common_frames(camera, cameras[j], options) for j in kept),
            float(options.min_common_frames),
            "images",
            others,
        )
    return UncalibratedCamera(camera.name, rejection)


def _require_motion(cameras: Sequence[LiftedCamera]) -> None:
    movement = [movement_of(track, camera.stamps) for camera in cameras for track in camera.tracks]
    most = max(movement, default=0.0)
    if most < MIN_MOVEMENT:
        still = Rejection(
            RejectionReason.NO_MOTION, measured=most, limit=MIN_MOVEMENT, unit="body heights"
        )
        raise Insufficient(Status.DEGENERATE, still)


def movement_of(track: LiftedTrack, stamps: Float64Array) -> float:
    """Return the slow movement of the limbs that move most, over the height of the body.

    The range of the keypoints in time (10 % to 90 %, so that short exchanges of left and
    right do not count), after noise from image to image has been averaged away; of the
    joints, the 90th percentile, since people may move their arms only.
    """
    period = frame_period(stamps)
    width = max(1, round(_SMOOTHING_S / period)) if np.isfinite(period) else 1
    F = len(track.frames)
    width = min(width, max(1, F // 2))
    if F < 2:
        return 0.0
    known = np.isfinite(track.x[..., 0])
    n = _moving_sum(known.astype(float), width)
    smooth = _moving_sum(np.where(known[..., None], track.x, 0.0), width)
    smooth /= np.maximum(n, 1.0)[..., None]
    use = n > width / 2
    mean = (smooth * use[..., None]).sum(0) / np.maximum(use.sum(0), 1)[:, None]
    low, high = np.quantile(np.where(use[..., None], smooth, mean), [0.1, 0.9], axis=0)
    y = np.where(known, track.x[..., 1], 0.0)
    height = np.median(y.max(1, where=known, initial=-1e9) - y.min(1, where=known, initial=1e9))
    span = np.linalg.norm(high - low, axis=-1)
    return float(np.percentile(span, 90) / max(float(height), 1e-6))


def _moving_sum(values: Float64Array, width: int) -> Float64Array:
    """Return sums over `width` successive entries of the first axis."""
    total = np.cumsum(np.concatenate([np.zeros_like(values[:1]), values]), axis=0)
    return np.asarray(total[width:] - total[:-width])
