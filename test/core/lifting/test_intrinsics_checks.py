"""CameraInfo that contradicts itself or the keypoints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import changed, tracks_changed

from stcalib_ros.core.lifting.input_screening import screen_input
from stcalib_ros.core.lifting.intrinsics_checks import (
    focal_length_fault,
    intrinsics_faults,
    placement_fault,
    principal_point_fault,
)
from stcalib_ros.core.model.camera_info import intrinsics_from_camera_info
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.core.model.rejection import RejectionReason as R
from stcalib_ros.core.options import Options


def lens(fx=1400.0, fy=1400.0, cx=959.5, cy=539.5, size=(1920, 1080), model=LensModel.PLUMB_BOB):
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    return Intrinsics(*size, model, K, np.zeros(4))


def from_info(k, size, **more):
    fx, cx, fy, cy = k
    return intrinsics_from_camera_info(
        width=size[0],
        height=size[1],
        distortion_model="plumb_bob",
        d=[0.0] * 5,
        k=[fx, 0, cx, 0, fy, cy, 0, 0, 1],
        r=np.eye(3).ravel(),
        p=np.zeros(12),
        rectified=False,
        **more,
    )


@pytest.mark.parametrize(
    "given",
    [
        lens(),
        lens(fx=480.0, fy=480.0),
        lens(fx=600.0, fy=600.0, model=LensModel.EQUIDISTANT),
        lens(fx=700.0, fy=1400.0),
        lens(cx=860.0, cy=580.0),
        from_info((1400.0, 960.0, 1400.0, 540.0), (1920, 1080), roi=(1200, 0, 720, 1080)),
        from_info((1400.0, 960.0, 1400.0, 540.0), (1920, 1080), binning_x=2, binning_y=2),
    ],
    ids=["usual", "wide", "fisheye", "binned in x", "off by 5 %", "side of the sensor", "binned"],
)
def test_lenses_that_there_are_have_no_fault(given):
    assert focal_length_fault(given) is None
    assert principal_point_fault(given) is None


@pytest.mark.parametrize(
    ("given", "measured"),
    [
        (lens(fx=0.73, fy=1.3), 179.9),
        (lens(fx=80_000.0, fy=80_000.0), 1.37),
        (lens(fx=1400.0, fy=400.0), 3.5),
        (lens(fx=200.0, fy=200.0, model=LensModel.EQUIDISTANT), 550.0),
    ],
)
def test_absurd_focal_lengths_are_named(given, measured):
    found = focal_length_fault(given)
    assert found is not None
    assert found[0] is R.FOCAL_LENGTH_ABSURD
    assert found[1] == pytest.approx(measured, rel=0.01)


@pytest.mark.parametrize(
    ("given", "off"),
    [
        (lens(cx=0.5, cy=0.5), 0.5),
        (from_info((700.0, 480.0, 700.0, 270.0), (1920, 1080), binning_x=2, binning_y=2), 0.25),
        (lens(cx=719.5, cy=404.5), 0.125),
        (lens(cx=511.5, cy=639.5, size=(1280, 1024)), 0.125),
        (lens(cx=539.5, cy=959.5), 0.389),
        (lens(cx=1440.0), 0.25),
    ],
    ids=["shares", "binned twice", "three quarters", "exchanged", "exchanged wide", "to the side"],
)
def test_a_principal_point_far_from_the_middle_is_named(given, off):
    found = principal_point_fault(given)
    assert found is not None
    assert found[0] is R.PRINCIPAL_POINT_OFF_CENTRE
    assert found[1] == pytest.approx(off, abs=2e-3)
    assert found[1] > found[2]


def poses(low, high, n=200):
    """People of a quarter of the given part of the image, all over it."""
    low, high = np.array(low), np.array(high)
    at = np.random.default_rng(1).uniform(low, high - (high - low) / 4, (n, 1, 2))
    body = np.random.default_rng(2).uniform(0, 1, (n, 17, 2)) * (high - low) / 4
    return at + body


@pytest.mark.parametrize(
    ("low", "high"),
    [((0, 0), (1920, 1080)), ((0, 0), (960, 1080)), ((0, 540), (960, 1080)), ((0, 0), (200, 900))],
    ids=["everywhere", "left half", "lower left", "left edge"],
)
def test_people_in_a_part_of_the_image_are_no_fault(low, high):
    assert placement_fault(lens(), poses(low, high)) is None


@pytest.mark.parametrize("factor", [0.5, 1 / 3])
def test_people_of_a_smaller_image_are_all_in_its_corner(factor):
    found = placement_fault(lens(), factor * poses((0, 0), (1920, 1080)))
    assert found is not None
    assert found[0] is R.KEYPOINTS_IN_CORNER
    assert found[1] == pytest.approx(factor, abs=0.03)


def test_people_who_stand_in_the_corner_are_no_fault():
    assert placement_fault(lens(), poses((700, 300), (900, 500))) is None


def test_people_of_a_larger_image_are_outside():
    found = placement_fault(lens(), poses((0, 0), (3840, 2160)))
    assert found is not None
    assert found[0] is R.KEYPOINTS_OUTSIDE_IMAGE
    assert found[3]["most_x"] > 3000
    few = np.concatenate([poses((0, 0), (1920, 1080)), poses((2000, 0), (3840, 1080), 15)])
    assert placement_fault(lens(), few) is None


def test_nothing_is_said_of_few_poses():
    assert placement_fault(lens(), poses((0, 0), (3840, 2160), n=20)) is None


def test_faults_are_those_of_one_camera(small_scene):
    def third(track):
        return replace(track, keypoints=track.keypoints / 3)

    recording = changed(small_scene.recording, "cam1", tracks_changed(third))
    assert intrinsics_faults(small_scene.recording, min_score=0.3) == {}
    found = screen_input(recording, Options())
    assert {n: w.reason for n, w in found.faults.items()} == {"cam1": R.KEYPOINTS_IN_CORNER}
    assert found.faults["cam1"].cameras == ("cam1",)
    assert [bool(c.tracks) for c in found.recording.cameras] == [True, False, True]
