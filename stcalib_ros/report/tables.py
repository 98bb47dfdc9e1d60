"""The tables and sentences of a report."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from stcalib_ros.core.bundle.covariance import largest_stddev
from stcalib_ros.core.geometry.interpolation import frame_rate
from stcalib_ros.core.geometry.so3 import quaternion_from_matrix, rotation_angle
from stcalib_ros.core.model.calibration import (
    Calibration,
    CameraCalibration,
    PersonAssociation,
)
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.report.fits import KeypointFit
from stcalib_ros.report.markup import paragraph, table
from stcalib_ros.wording import (
    clock_text,
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
    "Numbers are the track ids of each camera's own tracker. Several of one camera are pieces of "
    "one person. The last column says how many times worse the keypoints would fit if this person "
    "were taken for somebody else: near 1, the two could not be distinguished."
)
LENSES_HELP = (
    "Lenses that were not given are estimated with the poses. ± is one standard deviation; "
    "numbers without it were held at what was given or assumed."
)
PAIRS_HELP = (
    "Bones: the median angle between the bones of a person's two monocular 3D poses, after the "
    "rotation between the cameras; 10 to 25 degrees are usual. These poses are rough, and the "
    "final adjustment does not use them. Epipolar: how far keypoints are from the lines on which "
    "the other camera sees them."
)


def cameras(c: Calibration, fits: Sequence[KeypointFit]) -> str:
    """Pose and clock of every camera, and its keypoints that fit."""
    unit = length_unit(c.metric)
    head = (
        "camera",
        f"position x, y, z [{unit}]",
        "quaternion x, y, z, w",
        "turned",
        "time offset",
        "keypoints that fit",
    )
    by_name = {fit.name: fit for fit in fits}
    return table([head, *(_camera(one, by_name.get(one.name), c.reference) for one in c.cameras)])


def _camera(camera: CameraCalibration, fit: KeypointFit | None, reference: str) -> tuple[str, ...]:
    position_stddev = largest_stddev(camera.covariance[:3, :3])
    turn_stddev = np.degrees(largest_stddev(camera.covariance[3:, 3:]))
    position, angle = ", ".join(decimals(camera.t_ref_cam, 3)), rotation_angle(camera.R_ref_cam)
    turned = f"{np.degrees(angle):.1f}°"
    if camera.name != reference:
        position += plus_minus(position_stddev, 3, _PLUS_MINUS)
        turned += plus_minus(float(turn_stddev), 2, _PLUS_MINUS)
    return (
        camera.name,
        position,
        ", ".join(decimals(quaternion_from_matrix(camera.R_ref_cam), 4)),
        turned,
        clock_text(camera, reference, _PLUS_MINUS),
        "-" if fit is None else f"{fit.n_fit} of {fit.n_seen} ({fit.share:.0%})",
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
            "t_cam + offset. ± is one standard deviation, in the least certain direction. It comes "
            "from the scatter of the keypoints: errors that all of them have in common are not in "
            "it, nor is that of the scale."
        ),
    )


def persons(c: Calibration) -> str:
    """List the tracks of every person."""
    head = ("person", "tracks", "error (rms)", "taken for another")
    rows = [
        (
            str(person.person_id),
            "; ".join(f"{name}: {_ids(person.tracks[name])}" for name in _order(c, person)),
            f"{person.reprojection_rms_px:.2f} px",
            margin_text(person.margin),
        )
        for person in c.persons
    ]
    return table([head, *rows])


def _order(c: Calibration, person: PersonAssociation) -> list[str]:
    """Names of the cameras that have tracks of a person, in the order of the calibration."""
    return [camera.name for camera in c.cameras if person.tracks.get(camera.name)]


def _ids(tracks: Sequence[int]) -> str:
    return ", ".join(map(str, tracks))


def pairs(c: Calibration) -> str:
    """List how well every two cameras agree."""
    head = ("cameras", "people in common", "bones", "epipolar (rms)")
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
    rate_hz = frame_rate(camera.stamps)
    seen = sum(int(np.isfinite(t.keypoints).all(-1).sum()) for t in camera.tracks)
    total = sum(t.keypoints[..., 0].size for t in camera.tracks)
    lifted = sum(int(np.isfinite(t.joints[..., 0]).any(-1).sum()) for t in camera.tracks)
    n_poses = sum(len(t.frames) for t in camera.tracks)
    span = f"{camera.stamps[0]:.2f} … {camera.stamps[-1]:.2f} s" if len(camera.stamps) else "-"
    return (
        camera.name,
        str(len(camera.stamps)),
        f"{rate_hz:.1f} Hz" if rate_hz else "-",
        span,
        str(len(camera.tracks)),
        f"{seen} of {total}",
        f"{lifted} of {n_poses}" if lifted else "none",
        camera.layout.name,
        f"{camera.intrinsics.width} x {camera.intrinsics.height} px",
    )
