"""The six cameras of the film: lenses, places, clocks and shutters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.film.meshes import units
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration, Status
from stcalib_ros.core.model.recording import Intrinsics, LensModel

WIDTH, HEIGHT = 640, 480
"""Pixels. Size of the images: that of a webcam which streams several people's poses live."""
_AIM_M = 0.8
"""Metres. Height over the floor at which the cameras look: the middle of a person. Chosen."""
_DROPPED = 0.5
"""Fraction of the images that the camera with variable stamps loses, at random. Chosen."""


@dataclass(frozen=True, slots=True)
class FilmCamera:
    """One camera.

    Attributes
    ----------
    name : str
    focal_px : float
    k1, k2 : float
        Radial distortion, OpenCV.
    eye : (float, float, float)
        Place in the room, metres.
    aim : (float, float)
        Point of the room over which it looks, metres.
    offset_s : float
        Reference clock when its own clock shows 0, at its first image.
    rate_hz : float
    line_time_s : float
        Line delay of a rolling shutter; 0: all rows at once.
    drops : bool
        It loses half of its images.
    """

    name: str
    focal_px: float
    k1: float
    k2: float
    eye: tuple[float, float, float]
    aim: tuple[float, float]
    offset_s: float
    rate_hz: float = 15.0
    line_time_s: float = 0.0
    drops: bool = False

    @property
    def lens(self) -> Intrinsics:
        """Pinhole with radial distortion; the principal point is a little off the middle."""
        cx, cy = 0.5 * WIDTH - 0.5 + 40 * self.k1, 0.5 * HEIGHT - 0.5 - 30 * self.k1
        K = np.array([[self.focal_px, 0, cx], [0, self.focal_px, cy], [0, 0, 1.0]])
        return Intrinsics(
            WIDTH, HEIGHT, LensModel.PLUMB_BOB, K, np.array([self.k1, self.k2, 0, 0, 0])
        )

    @property
    def pose(self) -> tuple[Float64Array, Float64Array]:
        """``x_cam = R_cam_world @ x_world + t_cam_world``."""
        forward = units(np.array([*self.aim, _AIM_M]) - self.eye)
        right = units(np.cross(forward, [0.0, 0.0, 1.0]))
        R = np.stack([right, np.cross(forward, right), forward])
        return R, -R @ np.array(self.eye)

    def ticks(self, seconds: float) -> IntArray:
        """Which ticks of its clock of `rate_hz` gave an image; the first one always does."""
        n = int(np.floor(seconds * self.rate_hz))
        if not self.drops:
            return np.arange(n)
        rng = np.random.default_rng(0)
        kept = rng.uniform(size=n) >= _DROPPED
        kept[0] = True
        return np.flatnonzero(kept)

    def stamps(self, seconds: float) -> Float64Array:
        """Stamps of its images by its own clock, seconds; its first image is at 0."""
        return self.ticks(seconds) / self.rate_hz


CAMERAS = (
    FilmCamera("cam0", 560.0, 0.0, 0.0, (4.1, -3.5, 1.75), (0.2, 0.1), 0.0),
    FilmCamera("cam1", 520.0, -0.12, 0.01, (4.2, 3.0, 2.45), (0.0, -0.2), 0.634),
    FilmCamera("cam2", 600.0, 0.0, 0.0, (-4.3, 3.1, 1.3), (0.1, 0.0), -0.8713, rate_hz=12.5),
    FilmCamera("cam3", 480.0, -0.2, 0.03, (-4.1, -3.4, 2.1), (0.0, 0.2), 0.2571, line_time_s=5e-5),
    FilmCamera("cam4", 500.0, 0.0, 0.0, (0.2, -4.1, 2.6), (0.0, 0.3), -0.4127, 30.0, drops=True),
    FilmCamera("cam5", 540.0, -0.05, 0.0, (-0.4, 4.05, 1.6), (0.1, 0.0), 0.9432),
)
"""In this film, four cameras are the first four of them."""


def truth(seconds: float) -> Calibration:
    """Return the true calibration, in the frame and by the clock of the first camera, metres.

    Parameters
    ----------
    seconds : float
        Length of the film of each camera.
    """
    R_ref_world, t_ref_world = CAMERAS[0].pose
    out = []
    for camera in CAMERAS:
        R_cam_world, t_cam_world = camera.pose
        R_ref_cam = R_ref_world @ R_cam_world.T
        out.append(
            CameraCalibration(
                name=camera.name,
                frame_id=f"{camera.name}_optical_frame",
                intrinsics=camera.lens,
                R_ref_cam=R_ref_cam,
                t_ref_cam=t_ref_world - R_ref_cam @ t_cam_world,
                covariance=np.zeros((6, 6)),
                time_offset_s=camera.offset_s,
                time_offset_stddev_s=0.0,
                line_time_s=camera.line_time_s,
            )
        )
    return Calibration(
        status=Status.OK,
        message="true values of a film that was made",
        reference=CAMERAS[0].name,
        metric=True,
        epoch_s=0.0,
        window_s=(
            min(camera.offset_s for camera in CAMERAS),
            max(camera.offset_s for camera in CAMERAS) + seconds,
        ),
        cameras=tuple(out),
        uncalibrated=(),
        persons=(),
        pairs=(),
        reprojection_rms_px=0.0,
        n_observations=0,
        n_inliers=0,
    )
