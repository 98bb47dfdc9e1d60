"""One movement as every camera saw it, by its own clock and by the common one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.residuals import at_images
from stcalib_ros.core.capture.evidence import CaptureEvidence
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.clocks import clock_correction
from stcalib_ros.core.reconstruction.trajectories import person_rows
from stcalib_ros.report.content import ReportContent
from stcalib_ros.report.room import Room

_LIMBS = ("wrist", "ankle", "elbow", "knee")
_MIN_SAMPLES = 10
_LONGEST_S = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Height of one joint in the images of one camera.

    Attributes
    ----------
    camera : str
    stamps_s : (N,) ndarray
        As the camera stamped them, seconds since the epoch of the recording.
    times_s : (N,) ndarray
        The same moments by the reference clock.
    height : (N,) ndarray
        Above the floor, in the calibration's unit; NaN where not seen, or where the keypoint does
        not fit.
    """

    camera: str
    stamps_s: Float64Array
    times_s: Float64Array
    height: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class Movement:
    """The joint that moves up and down the most, as several cameras saw it."""

    person_id: int
    joint: str
    reference: str
    curves: tuple[Curve, ...]


def liveliest_movement(content: ReportContent, room: Room) -> Movement | None:
    """The joint with the most up and down in the most cameras; None if there is none.

    A height is that of the point on the camera's own line of sight which is nearest to the
    triangulated joint: it follows from the camera's own keypoints, and only its distance from the
    others. Of long recordings only the liveliest few seconds are in it.
    """
    best: tuple[float, Movement] | None = None
    evidence, calibration = content.evidence, content.calibration
    if evidence is None:
        return None
    names = [camera.name for camera in calibration.cameras if camera.name in evidence.names]
    all_rows = person_rows(evidence.lifted, evidence.last)
    for person, rows in zip(content.people, all_rows, strict=True):
        sights = _sights(evidence, names, room, rows)
        for j, joint in enumerate(evidence.skeleton.layout.joint_names):
            if not any(limb in joint for limb in _LIMBS):
                continue
            for part in _parts(sights.times_s):
                curves = _curves(names, sights, part, j)
                liveliness = sum(_spread(curve.height) for curve in curves)
                if len(curves) >= 2 and (best is None or liveliness > best[0]):
                    movement = Movement(person.person_id, joint, calibration.reference, curves)
                    best = liveliness, movement
    return None if best is None else _by_own_clock(best[1], content)


def _by_own_clock(movement: Movement, content: ReportContent) -> Movement:
    """Return the same with the stamps of the cameras; so far both times are by the common clock."""
    since_epoch_s = content.recording.epoch_ns * 1e-9 - content.calibration.epoch_s
    cameras = {camera.name: camera for camera in content.calibration.cameras}
    curves = []
    for curve in movement.curves:
        own = cameras[curve.camera]
        at_epoch = curve.times_s + since_epoch_s - own.time_offset_s
        later = clock_correction(own.time_offset_s, own.clock_skew, at_epoch)
        curves.append(replace(curve, stamps_s=curve.times_s - later))
    return replace(movement, curves=tuple(curves))


def _parts(times: Float64Array) -> list[slice]:
    """Rows of stretches of a few seconds, half overlapping."""
    middle = np.nanmean(times, axis=1)
    starts = np.arange(middle[0], max(middle[-1] - _LONGEST_S, middle[0]) + 1e-9, _LONGEST_S / 2.0)
    bounds = [np.searchsorted(middle, [start, start + _LONGEST_S]) for start in starts]
    return [slice(int(begin), int(end)) for begin, end in bounds]


def _curves(names: Sequence[str], sights: _Sights, part: slice, j: int) -> tuple[Curve, ...]:
    """Curves of one joint in one stretch, of the cameras that see enough of it."""
    return tuple(
        Curve(
            name,
            sights.times_s[part, c],
            sights.times_s[part, c],
            sights.heights[part, c, j],
        )
        for c, name in enumerate(names)
        if np.isfinite(sights.heights[part, c, j]).sum() >= _MIN_SAMPLES
    )


def _spread(height: Float64Array) -> float:
    known = height[np.isfinite(height)]
    low, high = np.percentile(known, [5, 95])
    return float(high - low) * len(known) / len(height)


@dataclass(frozen=True, slots=True, eq=False)
class _Sights:
    """What the cameras, in the order of the calibration, see of one person.

    Attributes
    ----------
    heights : (N, C, J) ndarray
    times_s : (N, C) ndarray
        By the common clock; NaN where there is no image.
    """

    heights: Float64Array
    times_s: Float64Array


def _sights(evidence: CaptureEvidence, names: Sequence[str], room: Room, rows: IntArray) -> _Sights:
    last = evidence.last
    obs, state = last.observations, last.state
    elapsed = obs.phi[rows] + state.shift_s
    X = at_images(obs, state, rows)
    known = (state.inlier[rows].sum(1) >= 2)[:, None] & state.inlier[rows]
    heights = np.full(known.shape, np.nan)
    for c, R_ref_cam in enumerate(last.rig.R_ref_cam):
        centre, direction = last.rig.t_ref_cam[c], _directions(obs, rows, c) @ R_ref_cam.T
        along = ((X[:, c] - centre) * direction).sum(-1, keepdims=True)
        point = room.placed(evidence.to_result(centre + along * direction))
        heights[:, c] = np.where(known[:, c], point[..., 2], np.nan)
    times = obs.start_s + obs.time_bin[rows][:, None] * obs.step_s + elapsed
    times = np.where(obs.track[rows] >= 0, times, np.nan)
    order = [evidence.names.index(name) for name in names]
    return _Sights(heights[:, order], times[:, order])


def _directions(obs: Observations, rows: IntArray, c: int) -> Float64Array:
    """Unit directions (N, J, 3) to the joints in the optical frame of camera c."""
    x = obs.x[rows, c]
    b = np.concatenate([x, np.ones_like(x[..., :1])], -1)
    return np.asarray(b / np.linalg.norm(b, axis=-1, keepdims=True))
