"""From the last round of adjustment to the published `Calibration`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stcalib_ros.core import stba
from stcalib_ros.core.association import Association
from stcalib_ros.core.averaging import Rig
from stcalib_ros.core.covariance import PARAMETERS
from stcalib_ros.core.lift import LiftedCamera
from stcalib_ros.core.quality import depth_scale, pair_residuals
from stcalib_ros.core.rounds import Round
from stcalib_ros.core.skeleton import Skeleton
from stcalib_ros.core.types import (
    Calibration,
    CameraCalibration,
    FloatArray,
    PersonAssociation,
    Recording,
    Status,
    UncalibratedCamera,
)

_MIN_TRACK_SHARE = 0.25


def make_calibration(
    recording: Recording,
    cameras: Sequence[LiftedCamera],
    skeleton: Skeleton,
    last: Round,
    covariance: FloatArray,
    *,
    status: Status,
    message: str,
    uncalibrated: Sequence[UncalibratedCamera],
) -> Calibration:
    """Put the result together, in metres or in units of the first baseline.

    Parameters
    ----------
    recording : Recording
    cameras : sequence of LiftedCamera
        All cameras of the recording.
    skeleton : Skeleton
    last : Round
    covariance : (7 C, 7 C) ndarray
        In the unit of the round.
    status : Status
    message : str
    uncalibrated : sequence of UncalibratedCamera
    """
    rig, o = last.rig, last.observations
    metric = all(recording.cameras[c].metric for c in rig.cameras)
    order = np.argsort(rig.cameras, kind="stable")
    unit = length_unit(cameras, last, metric=metric)
    grow = np.ones(len(covariance))
    grow[np.add.outer(7 * np.arange(len(order)), range(3)).ravel()] = unit
    rows = np.add.outer(7 * order, range(7)).ravel()
    covariance = (covariance * np.outer(grow, grow))[np.ix_(rows, rows)]
    errors = stba.errors_px(o, last.state)
    inliers = errors[last.state.used & np.isfinite(errors)]
    names = [recording.cameras[c].name for c in rig.cameras[order]]
    epoch = recording.epoch_ns * 1e-9
    window = _window(cameras, last)
    return Calibration(
        status=status,
        message=message,
        reference=recording.cameras[rig.cameras[0]].name,
        metric=metric,
        epoch_s=epoch,
        window_s=(epoch + window[0], epoch + window[1]),
        cameras=tuple(
            _camera(recording, last, int(c), unit, covariance[7 * i : 7 * i + 7, 7 * i : 7 * i + 7])
            for i, c in enumerate(order)
        ),
        uncalibrated=tuple(uncalibrated),
        persons=tuple(person for _, person in found_persons(cameras, last)),
        pairs=pair_residuals(cameras, skeleton, last),
        reprojection_rms_px=float(np.sqrt((inliers**2).mean())),
        n_observations=int(o.seen.sum()),
        n_inliers=len(inliers),
        joint_covariance=covariance,
        parameter_order=tuple(f"{name}.{parameter}" for name in names for parameter in PARAMETERS),
    )


def length_unit(cameras: Sequence[LiftedCamera], last: Round, *, metric: bool) -> float:
    """Factor from lengths of the adjustment to those of the result."""
    if metric:
        return depth_scale(cameras, last)
    first, second = np.argsort(last.rig.cameras, kind="stable")[:2]
    return 1.0 / float(np.linalg.norm(last.rig.t_ref_cam[second] - last.rig.t_ref_cam[first]))


def _window(cameras: Sequence[LiftedCamera], last: Round) -> tuple[float, float]:
    rig = last.rig
    begin = [cameras[c].stamps[0] + d for c, d in zip(rig.cameras, rig.offset_s, strict=True)]
    end = [cameras[c].stamps[-1] + d for c, d in zip(rig.cameras, rig.offset_s, strict=True)]
    return float(min(begin)), float(max(end))


def _camera(
    recording: Recording, last: Round, i: int, unit: float, block: FloatArray
) -> CameraCalibration:
    camera = recording.cameras[last.rig.cameras[i]]
    return CameraCalibration(
        name=camera.name,
        frame_id=camera.frame_id,
        intrinsics=camera.intrinsics,
        R_ref_cam=last.rig.R_ref_cam[i],
        t_ref_cam=last.rig.t_ref_cam[i] * unit,
        covariance=block[:6, :6],
        time_offset_s=float(last.rig.offset_s[i]),
        time_offset_stddev_s=float(np.sqrt(max(block[6, 6], 0.0))),
    )


def found_persons(
    cameras: Sequence[LiftedCamera], last: Round
) -> tuple[tuple[int, PersonAssociation], ...]:
    """Persons that at least two cameras see, numbered by how much is seen of them.

    Each with his number in the observations of the round.
    """
    o, association = last.observations, last.association
    errors = stba.errors_px(o, last.state)
    good = last.state.used & np.isfinite(errors)
    found = []
    for person in np.unique(o.person).tolist():
        rows = o.person == person
        tracks = tracks_of(cameras, last.rig, association, person)
        e = errors[rows][good[rows]]
        if len(tracks) >= 2 and len(e):
            rms = float(np.sqrt((e**2).mean()))
            margin = association.margins.get(person, float("inf"))
            found.append((len(e), person, tracks, rms, margin))
    found.sort(key=lambda f: -f[0])
    return tuple(
        (person, PersonAssociation(i, tracks, rms, margin))
        for i, (_, person, tracks, rms, margin) in enumerate(found)
    )


def tracks_of(
    cameras: Sequence[LiftedCamera], rig: Rig, association: Association, person: int
) -> dict[str, tuple[int, ...]]:
    """Tracks, by camera, that are this person for a good part of their time."""
    tracks = {}
    for i, c in enumerate(rig.cameras):
        slots = association.person_of[i]
        share = (slots == person).sum(1) / np.maximum((slots >= 0).sum(1), 1)
        if ids := tuple(
            cameras[c].tracks[p].track_id for p in np.flatnonzero(share >= _MIN_TRACK_SHARE)
        ):
            tracks[cameras[c].name] = ids
    return tracks


def nothing(
    recording: Recording,
    *,
    status: Status,
    message: str,
    uncalibrated: Sequence[UncalibratedCamera],
) -> Calibration:
    """A result that says why there is none."""
    stamps = [s for c in recording.cameras for s in (c.stamps[:1], c.stamps[-1:]) if len(s)]
    epoch = recording.epoch_ns * 1e-9
    times = np.concatenate(stamps) if stamps else np.zeros(1)
    return Calibration(
        status=status,
        message=message,
        reference=recording.cameras[0].name if recording.cameras else "",
        metric=False,
        epoch_s=epoch,
        window_s=(epoch + float(times.min()), epoch + float(times.max())),
        cameras=(),
        uncalibrated=tuple(uncalibrated),
        persons=(),
        pairs=(),
        reprojection_rms_px=float("nan"),
        n_observations=0,
        n_inliers=0,
    )
