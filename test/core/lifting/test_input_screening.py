"""One camera's fault is its own; what all have is an error of the input."""

from __future__ import annotations

from dataclasses import replace

import pytest
from core_helpers import SMALL

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.lifting.input_screening import screen_input
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.core.model.rejection import RejectionReason
from stcalib_ros.core.options import Options
from stcalib_ros.core.synthetic import simulate


@pytest.fixture(scope="module")
def recording() -> Recording:
    return simulate(SMALL).recording


def _with_shares(camera: CameraRecording) -> CameraRecording:
    """The principal point as shares of the image."""
    K = camera.intrinsics.K.copy()
    K[:2, 2] = 0.5
    return replace(camera, intrinsics=replace(camera.intrinsics, K=K))


def test_a_camera_with_an_absurd_lens_sees_nobody_and_the_others_are_as_they_were(recording):
    first, *rest = recording.cameras
    found = screen_input(replace(recording, cameras=(_with_shares(first), *rest)), Options())
    assert found.faults[first.name].reason is RejectionReason.PRINCIPAL_POINT_OFF_CENTRE
    assert list(found.faults) == [first.name]
    assert [len(camera.tracks) for camera in found.recording.cameras] == [
        0,
        *(len(camera.tracks) for camera in rest),
    ]


def test_where_no_lens_can_be_the_input_is_refused_with_every_camera(recording):
    cameras = tuple(map(_with_shares, recording.cameras))
    with pytest.raises(InputError, match=r"cam0, cam1, .*: the principal point \(0.5, 0.5\)"):
        screen_input(replace(recording, cameras=cameras), Options())
