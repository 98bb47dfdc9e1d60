"""Cameras that are left out, group by group, with what is said of them."""

from __future__ import annotations

import numpy as np
import pytest

from stcalib_ros.core.integration.exclusions import (
    Disconnected,
    Exclusions,
    largest_group,
    largest_part,
)
from stcalib_ros.core.model.calibration import Insufficient, Status
from stcalib_ros.core.model.rejection import Rejection, RejectionReason
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.model.rig import Rig

NAMES = ["door", "desk", "wall", "roof", "gate"]


NONE = Exclusions(tuple(NAMES), offset_range_s=2.0)


def tied(*pairs):
    return [RelativePose(a, b, np.eye(3), np.ones(3), 0.0, ((0, 0),), 1.0) for a, b in pairs]


def reasons(exclusions):
    return {camera.name: camera.rejection for camera in exclusions.cameras}


def test_the_group_of_the_reference_is_kept_in_the_given_order():
    kept, exclusions = largest_group(NONE, [4, 0, 1, 2, 3], tied((2, 4), (0, 1), (1, 3)))
    assert kept == [4, 2]
    group = Rejection(
        RejectionReason.DISCONNECTED, ("door", "desk", "roof"), others=("gate", "wall")
    )
    assert reasons(exclusions) == dict.fromkeys(("door", "desk", "roof"), group)
    assert exclusions.cameras[0].reason.endswith("; it forms a separate group with desk, roof")
    assert not NONE.cameras


def test_without_company_the_reference_is_left_out_itself():
    kept, exclusions = largest_group(NONE, [0, 1, 2], tied((1, 2)))
    assert kept == [1, 2]
    alone = Rejection(RejectionReason.DISCONNECTED, ("door",), others=("desk", "wall"))
    assert reasons(exclusions) == {"door": alone}


def test_no_connection_at_all_is_too_little():
    with pytest.raises(Insufficient) as end:
        largest_group(NONE, [0, 1], [])
    assert end.value.rejection.reason is RejectionReason.NO_SHARED_MOTION
    assert end.value.rejection.limit == 2.0
    assert end.value.status is Status.INSUFFICIENT_DATA
    assert [camera.name for camera in end.value.uncalibrated] == ["desk"]


def test_a_part_of_a_rig_keeps_its_cameras():
    rig = Rig(np.array([3, 1, 0]), np.tile(np.eye(3), (3, 1, 1)), np.eye(3), np.arange(3.0), 1.0)
    part, exclusions = largest_part(NONE, rig, Disconnected(((0, 2), (1,))))
    assert part.cameras.tolist() == [3, 0]
    assert list(reasons(exclusions)) == ["desk"]
    assert reasons(exclusions)["desk"].reason is RejectionReason.UNMATCHED_OBSERVATIONS
    with pytest.raises(Insufficient) as end:
        largest_part(exclusions, rig, Disconnected(((0,), (1,), (2,))))
    assert end.value.rejection.reason is RejectionReason.NO_SHARED_OBSERVATIONS


def test_a_camera_that_is_tried_again_is_not_left_out():
    why = Rejection(RejectionReason.TOO_FEW_INLIERS, ("desk",), 9.0, 400.0)
    exclusions = NONE.adding([1, 3], why).reinstating([3])
    assert reasons(exclusions) == {"desk": why}
