"""Calibrations to be exported, and points to project through what was written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.calibration import (
    Calibration,
    CameraCalibration,
    PairResidual,
    Status,
)
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.core.reconstruction.trajectories import PersonTrajectory
from stcalib_ros.io.exports import EXPORTS, Exported, exported_files, write_files

K = np.array([[801.25, 0.0, 321.5], [0.0, 799.0625, 238.75], [0.0, 0.0, 1.0]])
PINHOLE = Intrinsics(640, 480, LensModel.PLUMB_BOB, K, np.zeros(0))
RADTAN = replace(PINHOLE, D=np.array([-0.21, 0.05, 1e-3, -2e-3]))
PLUMB_BOB = replace(PINHOLE, D=np.array([-0.21, 0.05, 1e-3, -2e-3, 0.01]))
RATIONAL = replace(
    PINHOLE,
    model=LensModel.RATIONAL_POLYNOMIAL,
    D=np.array([0.2, -0.1, 1e-3, -2e-3, 0.02, 0.19, -0.12, 0.03]),
)
THIN_PRISM = replace(RATIONAL, D=np.append(RATIONAL.D, [1e-3, 2e-4, -1e-3, 3e-4]))
FISHEYE = replace(PINHOLE, model=LensModel.EQUIDISTANT, D=np.array([0.02, -0.01, 1e-3, 2e-4]))
RECTIFIED = replace(PINHOLE, R_rect_cam=exp_so3(np.array([0.02, -0.03, 0.01])))

POINTS = np.random.default_rng(15).uniform([-1.5, -1.0, 4.0], [1.5, 1.0, 7.0], (30, 3))
"""In the reference frame, ahead of all cameras."""


def camera(number: int, lens: Intrinsics) -> CameraCalibration:
    return CameraCalibration(
        name=f"cam{number}",
        frame_id=f"cam{number}_optical_frame",
        intrinsics=lens,
        R_ref_cam=exp_so3(number * np.array([0.05, -0.1, 0.02])),
        t_ref_cam=number * np.array([0.3, 0.1, -0.2]),
        covariance=1e-6 * np.eye(6),
        time_offset_s=0.125 * number,
        time_offset_stddev_s=1e-4,
    )


def rig(*lenses: Intrinsics) -> Calibration:
    """Cameras cam0, cam1, ... with these lenses; the first is the reference."""
    cameras = tuple(camera(number, lens) for number, lens in enumerate(lenses))
    pairs = (PairResidual("cam0", "cam1", 3, 0.01, 1.0),)
    return Calibration(
        *(Status.OK, "", "cam0", True, 10.0, (10.0, 20.0)),
        *(cameras, (), (), pairs, 1.0, 100, 90),
    )


def in_world(calibration: Calibration) -> Calibration:
    """Return the same rig in a frame with z up, in which no camera is the reference."""
    R, t = exp_so3(np.array([-1.6, 0.2, 0.1])), np.array([1.0, 2.0, 1.5])
    moved = tuple(
        replace(c, R_ref_cam=R @ c.R_ref_cam, t_ref_cam=R @ c.t_ref_cam + t)
        for c in calibration.cameras
    )
    return replace(calibration, cameras=moved, frame_id="world")


def points_of(calibration: Calibration) -> NDArray[np.float64]:
    """Return `POINTS` in the frame of a calibration: that of its first camera is the points'."""
    first = calibration.cameras[0]
    return np.asarray(POINTS @ first.R_ref_cam.T + first.t_ref_cam)


def pixels(calibration: Calibration, one: CameraCalibration) -> NDArray[np.float64]:
    """Project `points_of` by the package itself."""
    points_cam = (points_of(calibration) - one.t_ref_cam) @ one.R_ref_cam
    return project(points_cam, one.intrinsics)


def opencv_pixels(
    points: NDArray[np.float64],
    R: NDArray[np.float64],
    t: NDArray[np.float64],
    matrix: NDArray[np.float64],
    distortion: NDArray[np.float64],
    *,
    fisheye: bool,
) -> NDArray[np.float64]:
    """Project points of the reference frame by OpenCV."""
    projector = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    rvec = cv2.Rodrigues(np.asarray(R, float))[0]
    found, _ = projector(
        np.ascontiguousarray(points[:, None]), rvec, np.asarray(t, float), matrix, distortion
    )
    return np.asarray(found).reshape(-1, 2)


def person() -> PersonTrajectory:
    """Someone in front of the cameras for two seconds, of whom one joint is not known."""
    layout = LAYOUTS["coco_17"]
    joints = np.random.default_rng(3).normal([0.0, 0.0, 5.0], 0.4, (20, len(layout.parents), 3))
    joints[4, 7] = np.nan
    stddev = np.full(joints.shape[:2], 0.01)
    return PersonTrajectory(0, layout, 0.1 * np.arange(20.0), joints, stddev)


def written(
    calibration: Calibration, form: str, path: Path, people: tuple[PersonTrajectory, ...] = ()
) -> Path:
    """Write a calibration in a format, and return where."""
    if not EXPORTS[form].endings:
        path.mkdir()
    write_files(exported_files(Exported(calibration, people), EXPORTS[form], path))
    return path
