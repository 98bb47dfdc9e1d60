"""Cameras that show a mirror image of the people whom the others see."""

from __future__ import annotations

from dataclasses import replace

import pytest
from core_helpers import changed, error, lifted, tracks_changed

import stcalib_ros as st
from stcalib_ros.core.model.rejection import RejectionReason
from stcalib_ros.core.model.skeleton import mirrored_joints
from stcalib_ros.core.options import Options
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.reconstruction.limits import MIN_MIRRORED_FIT
from stcalib_ros.core.reconstruction.mirrored_view import mirrored_view

SCENE = st.simulate(st.SceneOptions(n_cameras=3, n_people=3, n_frames=300, seed=1))
KEYPOINTS = st.keypoints_only(SCENE.recording)


def mirrored(track):
    return replace(track, keypoints=track.keypoints * [-1.0, 1.0] + [1919.0, 0.0])


def as_named(track):
    """An estimator names the sides of a mirror image as it sees them."""
    sides = mirrored_joints(KEYPOINTS.cameras[0].layout)
    points = mirrored(track).keypoints[:, sides]
    return replace(track, keypoints=points, scores=track.scores[:, sides])


def swapped(track):
    return replace(track, keypoints=track.keypoints[..., ::-1])


@pytest.fixture(scope="module")
def others():
    """Cameras 0 and 2, adjusted."""
    cameras = (KEYPOINTS.cameras[0], KEYPOINTS.cameras[2])
    return run_stages(replace(KEYPOINTS, cameras=cameras), Options(offset_range_s=0.5))


def view_of(others, camera):
    """What is said of a camera beside the others."""
    cameras = (KEYPOINTS.cameras[0], KEYPOINTS.cameras[2], camera)
    skeleton, views = lifted(replace(KEYPOINTS, cameras=cameras))
    return mirrored_view(views, 2, skeleton, others.iterations[-1], Options(offset_range_s=0.5))


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (mirrored, "left and right of it"),
        (as_named, "left and right of it, and of the body,"),
        (swapped, "x and y"),
    ],
)
def test_a_mirror_image_is_recognised(others, change, what):
    found = view_of(others, tracks_changed(change)(KEYPOINTS.cameras[1]))
    assert (found.reason, found.cameras) == (RejectionReason.MIRRORED_VIEW, ("cam1",))
    assert found.detail == what
    assert found.measured > found.limit == MIN_MIRRORED_FIT


def test_other_views_are_no_mirror_images(others):
    strange = st.simulate(st.SceneOptions(n_cameras=3, n_people=3, n_frames=300, seed=51))
    assert view_of(others, st.keypoints_only(strange.recording).cameras[1]) is None
    assert view_of(others, KEYPOINTS.cameras[1]) is None


@pytest.mark.parametrize("change", [mirrored, as_named])
def test_a_mirrored_view_is_named_and_left_out(change):
    found = st.calibrate(changed(KEYPOINTS, "cam1", tracks_changed(change)))
    assert [camera.name for camera in found.cameras] == ["cam0", "cam2"]
    (left_out,) = found.uncalibrated
    assert left_out.rejection.reason is RejectionReason.MIRRORED_VIEW
    assert error(found, SCENE.truth).E_R < 0.005
