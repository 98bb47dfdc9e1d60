"""Which calibration stays in force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stcalib_ros.core.model.calibration import Calibration, CameraCalibration, Status
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.core.monitoring.replacement import rotation_stddev_rad, should_replace

LENS = Intrinsics(640, 480, LensModel.PLUMB_BOB, np.diag([600.0, 600.0, 1.0]), np.zeros(5))


def calibration(
    n_cameras: int = 3, n_inliers: int = 100, stddev_rad: float = 0.01, status: Status = Status.OK
) -> Calibration:
    covariance = np.diag([9.0, 9.0, 9.0, *3 * [stddev_rad**2]])
    cameras = tuple(
        CameraCalibration(f"cam{i}", "", LENS, np.eye(3), np.zeros(3), covariance * (i > 0), 0, 0)
        for i in range(n_cameras)
    )
    return Calibration(
        status, "why", "cam0", True, 0.0, (0.0, 1.0), cameras, (), (), (), 1.0, 200, n_inliers
    )


@pytest.mark.parametrize(
    ("new", "requested", "taken", "reason"),
    [
        (calibration(4, 10, 1.0), False, True, "it has 4 cameras, the one in force has 3"),
        (calibration(2, 900, 0.001), True, False, "it has 2 cameras, the one in force has 3"),
        (calibration(3, 100, 0.1), False, True, "it has 100 inliers, the one in force has 100"),
        (calibration(3, 99, 0.009), False, True, "its standard deviations are smaller: 0.009 rad"),
        (calibration(3, 99, 0.01), False, False, "deviations are not smaller: 0.01 rad, the one"),
        (calibration(3, 99, 0.1), True, True, "it was requested"),
        (calibration(4, 900, 0.001, Status.DEGENERATE), True, False, "DEGENERATE: why"),
    ],
)
def test_it_replaces_the_one_in_force(new, requested, taken, reason):
    decided, said = should_replace(new, calibration(), requested=requested)
    assert decided is taken
    assert reason in said


@pytest.mark.parametrize(
    ("new", "taken", "reason"),
    [
        (calibration(3, 99, 0.1), True, "the one in force is wrong: cam1 has moved"),
        (calibration(2, 900, 0.001), False, "it has 2 cameras"),
        (calibration(3, 900, 0.001, Status.DEGENERATE), False, "DEGENERATE: why"),
    ],
)
def test_one_that_is_wrong_is_replaced_by_a_less_supported_one(new, taken, reason):
    decided, said = should_replace(new, calibration(), requested=False, wrong="cam1 has moved")
    assert decided is taken
    assert reason in said


@pytest.mark.parametrize("status", Status)
def test_the_first_has_to_be_ok(status):
    taken, _ = should_replace(calibration(status=status), None, requested=False)
    assert taken is (status is Status.OK)


def test_the_reference_and_the_unknown_do_not_count():
    assert rotation_stddev_rad(calibration(stddev_rad=0.02)) == pytest.approx(0.02)
    unknown = calibration()
    nan = np.full((6, 6), np.nan)
    cameras = tuple(replace(camera, covariance=nan) for camera in unknown.cameras)
    assert rotation_stddev_rad(replace(unknown, cameras=cameras)) == np.inf
