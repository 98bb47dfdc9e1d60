"""The tables and sentences of a report."""

from __future__ import annotations

import math
from datetime import datetime, timezone

import numpy as np

from stcalib_ros.core.geometry.interpolation import frame_period
from stcalib_ros.core.geometry.so3 import quaternion_from_matrix, rotation_angle
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration, Status
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.core.model.rejection_text import whole_sentences
from stcalib_ros.core.stages import Stages
from stcalib_ros.report.draw_errors import CameraErrors, camera_errors
from stcalib_ros.report.markup import heading, paragraph, table
from stcalib_ros.wording import (
    clock_text,
    count,
    decimals,
    frame_text,
    length_unit,
    lens_rows,
    margin_text,
    plus_minus,
    scale_text,
)

_PLUS_MINUS = "±"

PERSONS_HELP = (
    "Tracks are the ids of each camera's own tracker; several of one camera are pieces of one "
    "person. The last column says how many times worse the keypoints would fit the next best "
    "assignment: near 1, two people could not be distinguished."
)
LENSES_HELP = (
    "Lenses that were not given are estimated with the poses. ± is one standard deviation; "
    "numbers without it were held at what was given or assumed."
)
PAIRS_HELP = (
    "Bones: median angle between the bones of the two monocular 3D poses of a person, after "
    "rotation; they are not used in the final adjustment, and the errors of two lifters together "
    "make 10 to 25 degrees; - without 3D poses. Epipolar: distance of the keypoints from the "
    "epipolar lines, rms."
)

_HEADINGS = {
    Status.OK: "Calibrated",
    Status.DEGENERATE: "Refused: the data does not determine the cameras",
    Status.INSUFFICIENT_DATA: "Refused: not enough data",
    Status.NOT_CONVERGED: "Refused: the adjustment did not converge",
    Status.CANCELLED: "Cancelled",
}
_NOT_TO_BE_USED = "Poses, offsets and persons below are intermediate results and must not be used."
_NO_POSES = "There are no poses. What the cameras saw is below: it may show what is missing."


def verdict(c: Calibration) -> str:
    """Say what the outcome is."""
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
        f"{len(c.cameras)} of {total} cameras, {count(len(c.persons), 'person')}; "
        f"{c.n_inliers} of {c.n_observations} observations are inliers, with a reprojection error "
        f"of {c.reprojection_rms_px:.2f} px (rms)."
    )
    if c.status is not Status.OK:
        return " ".join([*whole_sentences((), c.rejections), "Found:", found])
    return " ".join([found, *whole_sentences(c.remarks, c.rejections)])


def cameras(stages: Stages) -> str:
    """Pose and clock of every camera, and its inliers."""
    c = stages.calibration
    unit = length_unit(c.metric)
    head = (
        "camera",
        f"position x, y, z [{unit}]",
        "quaternion x, y, z, w",
        "turned",
        "clock offset",
        "inliers",
    )
    rows = [
        _camera(camera, errors, c.reference)
        for camera, errors in zip(c.cameras, camera_errors(stages), strict=True)
    ]
    return table([head, *rows])


def _camera(camera: CameraCalibration, errors: CameraErrors, reference: str) -> tuple[str, ...]:
    stddevs = np.sqrt(np.maximum(np.diag(camera.covariance), 0.0))
    position, angle = ", ".join(decimals(camera.t_ref_cam, 3)), rotation_angle(camera.R_ref_cam)
    turned = f"{np.degrees(angle):.1f}°"
    if camera.name != reference:
        position += plus_minus(float(np.linalg.norm(stddevs[:3])), 3, _PLUS_MINUS)
        turned += plus_minus(float(np.degrees(np.linalg.norm(stddevs[3:]))), 2, _PLUS_MINUS)
    return (
        camera.name,
        position,
        ", ".join(decimals(quaternion_from_matrix(camera.R_ref_cam), 4)),
        turned,
        clock_text(camera, reference, _PLUS_MINUS),
        f"{len(errors.inliers)} ({errors.inlier_fraction:.0%})",
    )


def lenses(c: Calibration) -> str:
    """List what was found of lenses that were not given; nothing if all were."""
    rows = lens_rows(c, _PLUS_MINUS)
    return table(rows) if rows else ""


def directions(c: Calibration) -> tuple[str, str]:
    """Say which way the transforms point, the sign of the offsets and the unit."""
    return (
        paragraph(
            f"Poses are T_ref_cam: x_ref = R x_cam + t maps a point from the optical frame of a "
            f"camera (x right, y down, z forward) to {frame_text(c)}; t is the position of the "
            f"camera. Lengths are in {scale_text(c)}."
        ),
        paragraph(
            f"Add an offset to the stamps of a camera to have the clock of {c.reference}: t_ref = "
            f"t_cam + offset. ± is one standard deviation, from the scatter of the observations; "
            f"errors that all people have in common are not in it, nor is that of the scale."
        ),
    )


def uncalibrated(c: Calibration) -> str:
    """List the cameras without a pose, with the reasons."""
    return table([("camera", "why"), *((u.name, u.reason) for u in c.uncalibrated)], wrapped=(1,))


def persons(c: Calibration) -> str:
    """List the tracks of every person."""
    names = [camera.name for camera in c.cameras]
    head = ("person", *names, "reprojection", "next best assignment")
    rows = [
        (
            str(p.person_id),
            *(", ".join(map(str, p.tracks.get(name, ()))) or "-" for name in names),
            f"{p.reprojection_rms_px:.2f} px",
            margin_text(p.margin),
        )
        for p in c.persons
    ]
    return table([head, *rows])


def pairs(c: Calibration) -> str:
    """List how well every two cameras agree."""
    head = ("cameras", "persons in common", "bones", "epipolar")
    rows = [
        (
            f"{p.camera_a}, {p.camera_b}",
            str(p.n_matches),
            "-" if math.isnan(p.median_angle_rad) else f"{math.degrees(p.median_angle_rad):.1f}°",
            f"{p.epipolar_rms_px:.2f} px",
        )
        for p in c.pairs
    ]
    return table([head, *rows])


def sightings(recording: Recording) -> str:
    """List what every camera observed, whether it could be used or not."""
    head = ("camera", "images", "rate", "stamps", "tracks", "keypoints", "3D poses", "layout")
    rows = (_sighting(camera) for camera in recording.cameras)
    return table([(*head, "image size"), *rows])


def _sighting(camera: CameraRecording) -> tuple[str, ...]:
    period = frame_period(camera.stamps)
    seen = sum(int(np.isfinite(t.keypoints).all(-1).sum()) for t in camera.tracks)
    total = sum(t.keypoints[..., 0].size for t in camera.tracks)
    lifted = sum(int(np.isfinite(t.joints[..., 0]).any(-1).sum()) for t in camera.tracks)
    n_poses = sum(len(t.frames) for t in camera.tracks)
    span = f"{camera.stamps[0]:.2f} … {camera.stamps[-1]:.2f} s" if len(camera.stamps) else "-"
    return (
        camera.name,
        str(len(camera.stamps)),
        f"{1.0 / period:.1f} Hz" if math.isfinite(period) and period > 0 else "-",
        span,
        str(len(camera.tracks)),
        f"{seen} of {total}",
        f"{lifted} of {n_poses}" if lifted else "none",
        camera.layout.name,
        f"{camera.intrinsics.width} x {camera.intrinsics.height} px",
    )
