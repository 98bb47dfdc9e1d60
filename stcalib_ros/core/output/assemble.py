"""From the last iteration of the adjustment to the published `Calibration`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.bundle.covariance import OFFSET_ROW, PARAMETERS, POSE_ROWS, rows_of
from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.lenses import CENTRE_X, CENTRE_Y, FOCAL, RADIAL, focal_length
from stcalib_ros.core.bundle.residuals import errors_px
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.calibration import (
    Calibration,
    CameraCalibration,
    Status,
    UncalibratedCamera,
)
from stcalib_ros.core.model.lens_knowledge import LensKnowledge, LensStddev
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.core.model.rejection import Rejection, Remark
from stcalib_ros.core.model.rejection_text import (
    left_out_sentences,
    rejection_sentences,
    remark_sentences,
)
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.output.world_frame import WorldAlignment
from stcalib_ros.core.reconstruction.people import found_persons
from stcalib_ros.core.validation.cross_view import pair_residuals
from stcalib_ros.core.validation.verdict import Judgement


def make_calibration(
    recording: Recording,
    cameras: Sequence[LiftedCamera],
    skeleton: Skeleton,
    last: Iteration,
    covariance: Float64Array,
    placement: WorldAlignment,
    *,
    judgement: Judgement,
    uncalibrated: Sequence[UncalibratedCamera],
    world_frame: str = "",
) -> Calibration:
    """Express a solution in the unit and frame of the result.

    Parameters
    ----------
    recording : Recording
    cameras : sequence of LiftedCamera
        All cameras of the recording.
    skeleton : Skeleton
    last : Iteration
    covariance : (7 C, 7 C) ndarray
        Covariance in the frame of the reference camera and the unit of the adjustment.
    placement : WorldAlignment
        Unit and frame of the result.
    judgement : Judgement
    uncalibrated : sequence of UncalibratedCamera
    world_frame : str
        Name of the frame of a result with z up.
    """
    rig, obs = last.rig, last.observations
    order = np.argsort(rig.cameras, kind="stable")
    since_s = _epoch_since_s(cameras, last)
    covariance = _published(placement.covariance_of(rig, covariance), order, last, since_s)
    inliers = last.state.inlier & np.isfinite(errors_px(obs, last.state))
    names = [recording.cameras[c].name for c in rig.cameras[order]]
    return Calibration(
        status=judgement.status,
        message=_summary(judgement, uncalibrated, calibrated=len(names)),
        rejections=judgement.rejections,
        remarks=judgement.remarks,
        reference=recording.cameras[rig.cameras[0]].name,
        metric=placement.metric,
        epoch_s=recording.epoch_ns * 1e-9 + since_s,
        window_s=_window(cameras, last, recording.epoch_ns * 1e-9),
        cameras=_cameras(recording, last, order, placement, covariance, since_s),
        uncalibrated=tuple(uncalibrated),
        persons=tuple(person for _, person in found_persons(cameras, last)),
        pairs=pair_residuals(cameras, skeleton, last),
        reprojection_rms_px=last.rms_px(),
        n_observations=int(obs.observed.sum()),
        n_inliers=int(inliers.sum()),
        frame_id="" if placement.upright is None else world_frame,
        scale_stddev=placement.scale_stddev,
        joint_covariance=covariance,
        parameter_order=tuple(f"{name}.{parameter}" for name in names for parameter in PARAMETERS),
    )


def _epoch_since_s(cameras: Sequence[LiftedCamera], last: Iteration) -> float:
    """Time at which offsets are published, whole seconds since the zero of the stamps.

    Just before the first image of a calibrated camera: a camera that was left out may have stamps
    of another epoch, decades away, to where no skew can be extrapolated.
    """
    return float(np.floor(min(cameras[c].stamps[0] for c in last.rig.cameras)))


def _published(
    covariance: Float64Array, order: IntArray, last: Iteration, since_s: float
) -> Float64Array:
    """Order the covariance (7 C, 7 C) by camera; time offsets are those at the epoch."""
    rows = rows_of(order).ravel()
    covariance = covariance[np.ix_(rows, rows)]
    offsets = rows_of(np.arange(len(order)))[:, OFFSET_ROW]
    covariance[offsets, offsets] += [_clock(last, int(c), since_s).added_variance for c in order]
    return covariance


def _cameras(
    recording: Recording,
    last: Iteration,
    order: IntArray,
    placement: WorldAlignment,
    covariance: Float64Array,
    since_s: float,
) -> tuple[CameraCalibration, ...]:
    """Return the cameras in the order of the recording, with their own blocks of the covariance."""
    return tuple(
        _camera(
            *(recording, last, int(c), placement),
            *(covariance[block, block], _clock(last, int(c), since_s)),
        )
        for c, block in zip(order, _blocks(len(order)), strict=True)
    )


def _blocks(n: int) -> list[slice]:
    return [slice(len(PARAMETERS) * i, len(PARAMETERS) * (i + 1)) for i in range(n)]


def _window(cameras: Sequence[LiftedCamera], last: Iteration, zero_s: float) -> tuple[float, float]:
    """First and last image, seconds by the reference clock."""
    rig = last.rig
    begin = [cameras[c].stamps[0] + d for c, d in zip(rig.cameras, rig.offset_s, strict=True)]
    end = [cameras[c].stamps[-1] + d for c, d in zip(rig.cameras, rig.offset_s, strict=True)]
    return zero_s + float(min(begin)), zero_s + float(max(end))


@dataclass(frozen=True, slots=True)
class _Clock:
    """Time offset at the epoch, skew, and the variance that the skew adds to the offset there."""

    offset_s: float
    skew: float = 0.0
    stddev: float = float("nan")
    added_variance: float = 0.0


def _clock(last: Iteration, i: int, since_s: float) -> _Clock:
    offset, rates = float(last.rig.offset_s[i]), last.clock_skews
    if last.line_delays is not None:
        offset += float(last.line_delays.first_row_s[i])
    if rates is None:
        return _Clock(offset)
    skew, stddev = float(rates.skew[i]), float(rates.stddev[i])
    to_epoch = since_s + offset - rates.middle_s
    added = 0.0 if skew == 0.0 else (to_epoch * stddev) ** 2
    return _Clock(offset + skew * to_epoch, skew, stddev, added)


def _camera(
    recording: Recording,
    last: Iteration,
    i: int,
    placement: WorldAlignment,
    block: Float64Array,
    clock: _Clock,
) -> CameraCalibration:
    camera, lines = recording.cameras[last.rig.cameras[i]], last.line_delays
    return CameraCalibration(
        name=camera.name,
        frame_id=camera.frame_id,
        intrinsics=camera.intrinsics,
        R_ref_cam=placement.R @ last.rig.R_ref_cam[i],
        t_ref_cam=placement.to_result(last.rig.t_ref_cam[i]),
        covariance=block[POSE_ROWS, POSE_ROWS],
        time_offset_s=clock.offset_s,
        time_offset_stddev_s=float(np.sqrt(max(block[OFFSET_ROW, OFFSET_ROW], 0.0))),
        clock_skew=clock.skew,
        clock_skew_stddev=clock.stddev,
        line_time_s=camera.line_time_s if lines is None else float(lines.line_s[i]),
        line_time_stddev_s=float("nan") if lines is None else float(lines.stddev_s[i]),
        lens_knowledge=camera.lens_knowledge or LensKnowledge.GIVEN,
        lens_stddev=_lens_stddev(camera, last, i),
    )


def _lens_stddev(camera: CameraRecording, last: Iteration, i: int) -> LensStddev | None:
    """How well the lens of a camera is known; None of one that was given."""
    if camera.lens_prior is None or last.lens_stddev is None or not last.lens_stddev[:, i].any():
        return None
    stddev = last.lens_stddev[:, i]
    focal_px = focal_length(camera.intrinsics)
    radial = stddev[RADIAL : RADIAL + len(camera.lens_prior.radial)]
    return LensStddev(
        focal_px=float(focal_px * stddev[FOCAL]),
        cx_px=float(focal_px * stddev[CENTRE_X]),
        cy_px=float(focal_px * stddev[CENTRE_Y]),
        radial=tuple(float(value) for value in radial),
    )


def failed_calibration(
    recording: Recording,
    status: Status,
    rejections: tuple[Rejection, ...],
    uncalibrated: Sequence[UncalibratedCamera] = (),
    remarks: tuple[Remark, ...] = (),
) -> Calibration:
    """Return a calibration without cameras, with the reasons.

    Parameters
    ----------
    recording : Recording
    status : Status
    rejections : tuple of Rejection
    uncalibrated : sequence of UncalibratedCamera
    remarks : tuple of Remark
        On the input.
    """
    stamps = [s for c in recording.cameras for s in (c.stamps[:1], c.stamps[-1:]) if len(s)]
    epoch = recording.epoch_ns * 1e-9
    times = np.concatenate(stamps) if stamps else np.zeros(1)
    return Calibration(
        status=status,
        message=_summary(Judgement(status, rejections, remarks), uncalibrated),
        rejections=rejections,
        remarks=remarks,
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


def _summary(
    judgement: Judgement, uncalibrated: Sequence[UncalibratedCamera], *, calibrated: int = 0
) -> str:
    """Return one line: what was found, or why not, and why cameras are missing.

    Where a reason against the calibration as a whole comes first, those of single cameras follow
    from it and would only make the line longer.
    """
    total = calibrated + len(uncalibrated)
    good = judgement.status is Status.OK
    parts = [f"{calibrated} of {total} cameras calibrated"] if good else []
    remarks = remark_sentences(judgement.remarks)
    parts += remarks if good else []
    rejections = judgement.rejections
    whole = not all(rejection.cameras for rejection in rejections[:1])
    parts += rejection_sentences([one for one in rejections if not (whole and one.cameras)])
    parts += left_out_sentences([(camera.name, camera.rejection) for camera in uncalibrated])
    parts += [] if good else remarks
    return "; ".join(parts)
