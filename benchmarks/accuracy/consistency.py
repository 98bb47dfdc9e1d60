"""Consistency of the covariances: normalized estimation errors squared (NEES).

    python -m benchmarks.accuracy.consistency
    python -m benchmarks.accuracy.consistency --only bias --scenes 10

For every camera but the reference, ``e^T C^-1 e / n`` of its rotation, centre and time offset, in
units of the first baseline: 1 on average where the covariances are right, more where they are too
small. Exit status 1 if a mean is outside its limits.

References
----------
Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001,
section 5.4.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import numpy as np

from benchmarks.accuracy.measure import run_calibration
from benchmarks.accuracy.scenarios import SCENARIOS, Scenario
from benchmarks.accuracy.weak import WEAK
from benchmarks.table import Row, print_rows
from stcalib_ros.core.evaluation.lens_errors import lens_error
from stcalib_ros.core.geometry.so3 import log_so3
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration, Status
from stcalib_ros.core.synthetic import simulate
from stcalib_ros.io.mocap import shipped_clips

POSE_BLOCKS = ("rotation", "centre", "offset")
LENS_BLOCKS = ("focal length", "principal point", "k1")
_WEAK_LIMITS = (0.5, 2.0)
_LIMITS = {
    "default": (0.7, 1.5),
    "bias": (0.5, 3.0),
    "rates": (0.5, 3.0),
    **{scenario.name: _WEAK_LIMITS for scenario in WEAK},
}
_RANK = 1e-6
"""Ratio of an eigenvalue to the largest below which a direction is fixed by the gauge."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark and print the table; 0 if all means are within their limits, else 1."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.accuracy.consistency", description=__doc__
    )
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--only", choices=list(_LIMITS), help="one scenario")
    parser.add_argument("--scenes", type=int, default=100, metavar="N", help="default 100")
    args = parser.parse_args(argv)
    met: bool = True
    for scenario in (*SCENARIOS, *WEAK):
        if scenario.name in _LIMITS and args.only in (None, scenario.name):
            rows = _rows(scenario, args.scenes)
            print_rows(f"{scenario.name}: {scenario.title}", rows, file=sys.stdout)
            met = met and all(row.met is not False for row in rows)
    return 0 if met else 1


def _rows(scenario: Scenario, n_scenes: int) -> list[Row]:
    found = [_scene(scenario, index) for index in range(n_scenes)]
    values = np.array([row for rows in found for row in rows]).reshape(-1, len(POSE_BLOCKS))
    low, high = _LIMITS[scenario.name]
    out = [Row("scenes", f"{sum(bool(rows) for rows in found)} of {n_scenes} calibrated", "", None)]
    for name, column in zip(POSE_BLOCKS, values.T, strict=True):
        mean = float(np.mean(column)) if len(column) else float("nan")
        p90 = float(np.percentile(column, 90)) if len(column) else float("nan")
        text = f"mean {mean:.2f}  p90 {p90:.2f}"
        out.append(Row(name, text, f"mean {low:g} to {high:g}", low <= mean <= high))
    return out


def _scene(scenario: Scenario, index: int) -> list[list[float]]:
    scene = simulate(scenario.scene_options(index), clips=shipped_clips())
    found = run_calibration(scene.recording).calibration
    complete = found is not None and len(found.cameras) == len(scene.truth.cameras)
    if found is None or not complete or found.status is not Status.OK:
        return []
    return normalised_errors(found, scene.truth)


def normalised_errors(found: Calibration, truth: Calibration) -> list[list[float]]:
    """Return the NEES per degree of freedom of rotation, centre and offset, for each camera.

    The reference camera is left out.
    """
    unit, true_unit = (1.0 / np.linalg.norm(c.cameras[1].t_ref_cam) for c in (found, truth))
    return [
        _of_camera(camera, true, float(unit), float(true_unit))
        for camera, true in zip(found.cameras[1:], truth.cameras[1:], strict=True)
    ]


def normalised_lens_errors(found: Calibration, truth: Calibration) -> list[list[float]]:
    """Return the NEES per degree of freedom of focal length, principal point and k1, per camera.

    NaN where it was not estimated, or the lens model is another one.
    """
    return [
        _of_lens(camera, true) for camera, true in zip(found.cameras, truth.cameras, strict=True)
    ]


def _of_lens(camera: CameraCalibration, true: CameraCalibration) -> list[float]:
    stddev, error = camera.lens_stddev, lens_error(camera, true)
    if stddev is None:
        return [float("nan")] * len(LENS_BLOCKS)
    off = camera.intrinsics.K[:2, 2] - true.intrinsics.K[:2, 2]
    k1 = stddev.radial[0] if stddev.radial else 0.0
    return [
        _square_ratio(error.focal * true.intrinsics.K[0, 0], stddev.focal_px),
        0.5 * (_square_ratio(off[0], stddev.cx_px) + _square_ratio(off[1], stddev.cy_px)),
        _square_ratio(error.radial[0], k1),
    ]


def _square_ratio(error: float, stddev: float) -> float:
    """Return ``(error / stddev)^2``; NaN where there is no standard deviation."""
    return (error / stddev) ** 2 if stddev > 0.0 else float("nan")


def _of_camera(
    camera: CameraCalibration, true: CameraCalibration, unit: float, true_unit: float
) -> list[float]:
    turned = log_so3(camera.R_ref_cam @ true.R_ref_cam.T)
    moved = camera.t_ref_cam * unit - true.t_ref_cam * true_unit
    shifted = np.array([camera.time_offset_s - true.time_offset_s])
    return [
        _normalised(turned, camera.covariance[3:, 3:]),
        _normalised(moved, camera.covariance[:3, :3] * unit**2),
        _normalised(shifted, np.array([[camera.time_offset_stddev_s**2]])),
    ]


def _normalised(error: Float64Array, covariance: Float64Array) -> float:
    """Return ``e^T C^+ e`` over the rank of C; the gauge fixes the length of the first baseline."""
    value, vector = np.linalg.eigh(covariance)
    free = value > _RANK * value.max()
    return float(((error @ vector[:, free]) ** 2 / value[free]).sum() / free.sum())


if __name__ == "__main__":
    sys.exit(main())
