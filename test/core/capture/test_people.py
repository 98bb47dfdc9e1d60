"""People by a calibration that is given, against the simulated truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import SMALL, changed, clock_shifted

from stcalib_ros.core.capture.people import Capture, capture_people, metres_of
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.recording import Recording, keypoints_only
from stcalib_ros.core.synthetic import Scene, simulate


@pytest.fixture(scope="module")
def scene() -> Scene:
    return simulate(replace(SMALL, n_frames=120, flip_rate=0.0))


@pytest.fixture(scope="module")
def capture(scene: Scene) -> Capture:
    return capture_people(scene.recording, scene.truth)


def errors(scene: Scene, capture: Capture, scale: float = 1.0) -> list[np.ndarray]:
    """Distances (K, J) of joints from those of the nearest true person."""
    found = []
    for person in capture.people:
        true = scene.joints_ref(person.times_s)
        off = np.linalg.norm(scale * person.joints_ref - true, axis=-1)
        found.append(min(off, key=np.nanmedian))
    return found


def test_joints_are_where_they_were(scene: Scene, capture: Capture) -> None:
    assert len(capture.people) == 2
    for off in errors(scene, capture):
        assert np.isfinite(off).mean() > 0.7
        assert np.nanmedian(off) < 0.02
    assert min(capture.explained.values()) > 0.7
    assert capture.reprojection_rms_px < 6.0


def test_deviations_are_as_large_as_errors(scene: Scene, capture: Capture) -> None:
    for person, off in zip(capture.people, errors(scene, capture), strict=True):
        assert (np.isfinite(person.stddev) == np.isfinite(person.joints_ref[..., 0])).all()
        assert 0.4 < np.nanmedian(off) / np.nanmedian(person.stddev) < 1.6


def test_2d_poses_are_enough(scene: Scene) -> None:
    found = capture_people(keypoints_only(scene.recording), scene.truth)
    assert len(found.people) == 2
    assert all(np.nanmedian(off) < 0.02 for off in errors(scene, found))


def in_units(truth: Calibration, metres: float) -> Calibration:
    cameras = tuple(replace(c, t_ref_cam=c.t_ref_cam / metres) for c in truth.cameras)
    return replace(truth, cameras=cameras, metric=False)


def test_lengths_are_in_the_unit_of_the_calibration(scene: Scene) -> None:
    calibration = in_units(scene.truth, 4.0)
    found = capture_people(scene.recording, calibration)
    assert all(np.nanmedian(off) < 0.02 for off in errors(scene, found, scale=4.0))
    assert np.nanmedian(found.people[0].stddev) < 0.01
    assert metres_of(calibration, found.people, scene.recording) == pytest.approx(4.0, rel=0.15)
    assert metres_of(scene.truth, found.people, scene.recording) == 1.0


def test_a_clock_that_was_set_since_is_seen_by_what_does_not_fit(scene: Scene) -> None:
    late = changed(scene.recording, "cam1", clock_shifted(0.7))
    assert capture_people(late, scene.truth).explained["cam1"] < 0.5


def test_people_whom_one_camera_sees_alone_are_not_there(scene: Scene) -> None:
    apart = changed(scene.recording, "cam1", clock_shifted(1000.0))
    two = Recording(apart.cameras[:2], apart.epoch_ns)
    found = capture_people(two, scene.truth)
    assert found.people == ()
    assert set(found.explained.values()) == {0.0}


def test_cameras_that_were_not_calibrated_are_named(scene: Scene) -> None:
    others = replace(scene.truth, cameras=scene.truth.cameras[:1])
    with pytest.raises(InputError, match="has cam0, cam1, cam2, and the calibration cam0;"):
        capture_people(scene.recording, others)
