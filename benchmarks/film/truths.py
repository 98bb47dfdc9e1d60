"""What is true of the film: calibration, lenses and the joints of everybody."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.film.cameras import CAMERAS, truth
from benchmarks.film.figures import LANDMARK_BONES
from benchmarks.film.walking import Walker
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.io.npz_files import read_npz
from stcalib_ros.io.results import write_result

_JOINTS_HZ = 30
"""Samples per second of the joints in the file: a cubic through them is within 1 mm. Chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class Joints:
    """Joints of everybody over time.

    Attributes
    ----------
    names : tuple of str
    spline : CubicSpline
        Over the reference clock, seconds: (P, J, 3), in the room, z up, metres.
    """

    names: tuple[str, ...]
    spline: CubicSpline

    def __call__(self, times: Float64Array) -> Float64Array:
        """Return the joints (T, P, J, 3) in the room at times of the reference clock."""
        return np.asarray(self.spline(times))


def write_truth(
    folder: Path, people: Sequence[Walker], span_s: tuple[float, float], seconds: float
) -> None:
    """Write ``truth.yaml``, which is also the file of the lenses, and ``truth.npz``."""
    write_result(truth(seconds), folder / "truth.yaml")
    times = np.arange(span_s[0], span_s[1] + 1 / _JOINTS_HZ, 1 / _JOINTS_HZ)
    joints = np.stack([person.landmarks(times) for person in people], axis=1)
    np.savez_compressed(
        folder / "truth.npz",
        time_s=times,
        joints_tenth_mm=np.round(joints * 1e4).astype(np.int32),
        joint_names=np.array(list(LANDMARK_BONES)),
        camera_names=np.array([camera.name for camera in CAMERAS]),
        R_cam_world=np.stack([camera.pose[0] for camera in CAMERAS]),
        t_cam_world=np.stack([camera.pose[1] for camera in CAMERAS]),
    )


def read_joints(folder: Path) -> Joints:
    """Read ``truth.npz``.

    Raises
    ------
    InputError
        It cannot be read.
    """
    arrays = read_npz(folder / "truth.npz")
    joints = arrays["joints_tenth_mm"] * 1e-4
    names = tuple(str(name) for name in arrays["joint_names"])
    return Joints(names, CubicSpline(arrays["time_s"], joints))
