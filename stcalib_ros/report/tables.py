"""The tables and sentences of a report."""

from __future__ import annotations

import math
from datetime import datetime, timezone

import numpy as np

from stcalib_ros.core.geometry.interpolation import frame_period
from stcalib_ros.core.geometry.so3 import quaternion_from_matrix, rotation_angle
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration, Status
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.core.model.rejection_text import whole_sentences
from stcalib_ros.core.model.rolling_shutter import line_time_text
from stcalib_ros.core.stages import Stages
from stcalib_ros.report.draw_errors import CameraErrors, camera_errors
from stcalib_ros.report.markup import heading, paragraph, table

PERSONS_HELP = (
    "Tracks are the ids of each camera's own tracker; several of one camera are pieces of one "
    "person. The last column says how many times worse the key points would fit the next best "
    "assignment: near 1, two people could not be told apart."
)
PAIRS_HELP = (
    "Bones: median angle between the bones of the two monocular 3D poses of a person, after "
    "rotation; they have no part in the final adjustment, and the errors of two lifters together "
    "make 10 to 25 degrees. Epipolar: distance of the key points from the epipolar lines, rms."
)

_HEADINGS = {
    Status.OK: "Calibrated",
    Status.DEGENERATE: "Refused: the data does not determine the cameras",
    Status.INSUFFICIENT_DATA: "Refused: too little to go on",
    Status.NOT_CONVERGED: "Refused: the adjustment did not settle",
    Status.CANCELLED: "Cancelled",
}
_NOT_TO_BE_USED = (
    "Whatever poses, offsets and persons are shown below are what was found on the way. They are "
    "not to be used."
)
_NO_POSES = "There are no poses. What the cameras saw is below: it may show what is missing."


def verdict(c: Calibration) -> str:
    """What came out, in plain words."""
    parts = [heading(_HEADINGS[c.status], good=c.status is Status.OK), paragraph(_sentence(c))]
    if c.status is not Status.OK:
        parts.append(paragraph(_NOT_TO_BE_USED if c.cameras else _NO_POSES))
    begin, end = c.window_s
    started = datetime.fromtimestamp(begin, timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")
    parts.append(paragraph(f"Recording of {started}, {end - begin:.2f} s.", faint=True))
    return "\n".join(parts)


def _sentence(c: Calibration) -> str:
    if not c.cameras:
        return " ".join(whole_sentences((), c.rejections))
    total = len(c.cameras) + len(c.uncalibrated)
    found = (
        f"{len(c.cameras)} of {total} cameras, {_count(len(c.persons), 'person')}; "
        f"{c.n_inliers} of {c.n_observations} image points fit, with a reprojection error of "
        f"{c.reprojection_rms_px:.2f} px (rms)."
    )
    if c.status is not Status.OK:
        return " ".join([*whole_sentences((), c.rejections), "Found:", found])
    return " ".join([found, *whole_sentences(c.remarks, c.rejections)])


def _count(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def cameras(stages: Stages) -> str:
    """Pose and clock of every camera, and what they rest on."""
    c = stages.calibration
    unit = "m" if c.metric else "baselines"
    head = (
        "camera",
        f"position x, y, z [{unit}]",
        "quaternion x, y, z, w",
        "turned",
        "clock offset",
        "image points that fit",
    )
    rows = [
        _camera(camera, errors, c.reference)
        for camera, errors in zip(c.cameras, camera_errors(stages), strict=True)
    ]
    return table([head, *rows])


def _camera(camera: CameraCalibration, errors: CameraErrors, reference: str) -> tuple[str, ...]:
    deviations = np.sqrt(np.maximum(np.diag(camera.covariance), 0.0))
    is_reference = camera.name == reference
    position, angle = _numbers(camera.t_ref_cam, 3), rotation_angle(camera.R_ref_cam)
    turned = f"{np.degrees(angle):.1f}°"
    if not is_reference:
        position += _plus_minus(float(np.linalg.norm(deviations[:3])), 3)
        turned += _plus_minus(float(np.degrees(np.linalg.norm(deviations[3:]))), 2)
    return (
        camera.name,
        position,
        _numbers(quaternion_from_matrix(camera.R_ref_cam), 4),
        turned,
        "reference" + line_time_text(camera) if is_reference else _offset(camera),
        f"{len(errors.inliers)} ({errors.share:.0%})",
    )


def _offset(camera: CameraCalibration) -> str:
    text = f"{1e3 * camera.time_offset_s:+.2f} ms"
    text += _plus_minus(1e3 * camera.time_offset_stddev_s, 2)
    if camera.clock_skew:
        text += f", {1e6 * camera.clock_skew:+.1f} ppm"
    return text + line_time_text(camera)


def _numbers(values: Float64Array, digits: int) -> str:
    return ", ".join(f"{v + 0.0:.{digits}f}" for v in np.round(values, digits))


def _plus_minus(deviation: float, digits: int) -> str:
    return f" ± {deviation:.{digits}f}" if math.isfinite(deviation) else ""


def directions(c: Calibration) -> tuple[str, str]:
    """Which way the transforms point, the sign of the offsets, the unit."""
    return (
        paragraph(
            f"Poses are T_ref_cam: x_ref = R x_cam + t brings a point from the optical frame of a "
            f"camera (x right, y down, z forward) to {_frame(c)}; t is where the camera is. "
            f"{_unit(c)}"
        ),
        paragraph(
            f"Add an offset to the stamps of a camera to have the clock of {c.reference}: t_ref = "
            f"t_cam + offset. ± is one standard deviation by the scatter of the image points; what "
            f"is off in everybody all the time is not in it, and neither is the unit of length."
        ),
    )


def _frame(c: Calibration) -> str:
    if not c.frame_id:
        return f"that of {c.reference}"
    return f"{c.frame_id} (z up, floor at 0, below {c.reference}, which looks along x)"


def _unit(c: Calibration) -> str:
    if not c.metric:
        return (
            "The unit of length is the distance between the first two cameras, since nothing says "
            "how long a metre is."
        )
    if not math.isfinite(c.scale_stddev):
        return "Lengths are metres."
    return f"Lengths are metres, good to {100 * c.scale_stddev:.2g} %."


def uncalibrated(c: Calibration) -> str:
    """Cameras without a pose, with the reasons."""
    return table([("camera", "why"), *((u.name, u.reason) for u in c.uncalibrated)], wrapped=(1,))


def persons(c: Calibration) -> str:
    """Who is who."""
    names = [camera.name for camera in c.cameras]
    head = ("person", *names, "reprojection", "next best assignment")
    rows = [
        (
            str(p.person_id),
            *(", ".join(map(str, p.tracks.get(name, ()))) or "-" for name in names),
            f"{p.reprojection_rms_px:.2f} px",
            f"{p.margin:.1f} x worse" if math.isfinite(p.margin) else "nobody else there",
        )
        for p in c.persons
    ]
    return table([head, *rows])


def pairs(c: Calibration) -> str:
    """How well cameras agree two by two."""
    head = ("cameras", "persons in common", "bones", "epipolar")
    rows = [
        (
            f"{p.camera_a}, {p.camera_b}",
            str(p.n_matches),
            f"{math.degrees(p.median_angle_rad):.1f}°",
            f"{p.epipolar_rms_px:.2f} px",
        )
        for p in c.pairs
    ]
    return table([head, *rows])


def sightings(recording: Recording) -> str:
    """What every camera has seen, whether it could be used or not."""
    head = ("camera", "images", "rate", "stamps", "tracks", "key points", "layout", "image size")
    return table([head, *(_sighting(camera) for camera in recording.cameras)])


def _sighting(camera: CameraRecording) -> tuple[str, ...]:
    period = frame_period(camera.stamps)
    seen = sum(int(np.isfinite(t.keypoints).all(-1).sum()) for t in camera.tracks)
    total = sum(t.keypoints[..., 0].size for t in camera.tracks)
    span = f"{camera.stamps[0]:.2f} … {camera.stamps[-1]:.2f} s" if len(camera.stamps) else "-"
    return (
        camera.name,
        str(len(camera.stamps)),
        f"{1.0 / period:.1f} Hz" if math.isfinite(period) and period > 0 else "-",
        span,
        str(len(camera.tracks)),
        f"{seen} of {total}",
        camera.layout.name,
        f"{camera.intrinsics.width} x {camera.intrinsics.height} px",
    )
