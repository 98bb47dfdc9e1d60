"""Normalised errors: closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.accuracy.consistency import normalised_errors, normalised_lens_errors
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.lens_knowledge import LensStddev
from stcalib_ros.core.synthetic import SceneOptions, simulate


@pytest.fixture(scope="module")
def truth():
    options = SceneOptions(n_frames=10, n_cameras=3, n_people=1)
    return simulate(options).truth


def test_errors_are_measured_in_deviations(truth):
    """Two deviations of each kind, whatever the unit of the result."""
    sigma, unit = 0.01, 3.0
    block = np.diag([(unit * sigma) ** 2] * 3 + [sigma**2] * 3)
    first, second, third = (
        replace(c, t_ref_cam=unit * c.t_ref_cam, covariance=block, time_offset_stddev_s=sigma)
        for c in truth.cameras
    )
    third = replace(
        third,
        R_ref_cam=exp_so3(np.array([2 * sigma, 0, 0])) @ third.R_ref_cam,
        t_ref_cam=third.t_ref_cam + np.array([0, 2 * unit * sigma, 0]),
        time_offset_s=third.time_offset_s + 2 * sigma,
    )
    exact, off = normalised_errors(replace(truth, cameras=(first, second, third)), truth)
    assert exact == pytest.approx([0, 0, 0], abs=1e-9)
    assert off == pytest.approx([4 / 3, 4 / 3, 4])


def test_directions_without_deviation_do_not_count(truth):
    along = truth.cameras[1].t_ref_cam / np.linalg.norm(truth.cameras[1].t_ref_cam)
    across = 1e-4 * (np.eye(3) - np.outer(along, along))
    block = np.zeros((6, 6))
    block[:3, :3], block[3:, 3:] = across, 1e-4 * np.eye(3)
    cameras = tuple(replace(c, covariance=block, time_offset_stddev_s=0.01) for c in truth.cameras)
    side = np.cross(along, [0.6, 0.0, 0.8])
    side /= np.linalg.norm(side)
    length = np.linalg.norm(cameras[1].t_ref_cam)
    t = cameras[1].t_ref_cam * np.cos(0.01 / length) + side * length * np.sin(0.01 / length)
    moved = (cameras[0], replace(cameras[1], t_ref_cam=t), cameras[2])
    centre = normalised_errors(replace(truth, cameras=moved), truth)[0][1]
    assert centre == pytest.approx(0.5, rel=1e-2)


def test_errors_of_lenses_are_measured_in_deviations(truth):
    lens = truth.cameras[1].intrinsics
    K = lens.K + np.array([[28.0, 0, 6.0], [0, 28.0, 0], [0, 0, 0]])
    off = replace(lens, K=K, D=np.array([0.03, 0, 0, 0, 0]))
    stddev = LensStddev(14.0, 3.0, 3.0, (0.01,))
    first, second, third = truth.cameras
    second = replace(second, intrinsics=off, lens_stddev=stddev)
    third = replace(third, lens_stddev=LensStddev(14.0, 0.0, 0.0))
    found = normalised_lens_errors(replace(truth, cameras=(first, second, third)), truth)
    assert np.isnan(found[0]).all()
    assert found[1] == pytest.approx([4.0, 2.0, 9.0])
    assert found[2][0] == 0.0
    assert np.isnan(found[2][1:]).all()
