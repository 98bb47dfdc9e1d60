"""Cameras that are left out, group by group, with what is said of them."""

from __future__ import annotations

import numpy as np
import pytest

from stcalib_ros.core.integration.exclusions import Disconnected, Exclusions
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.model.rejection import Insufficient
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.model.rig import Rig

NAMES = ["door", "desk", "wall", "roof", "gate"]


@pytest.fixture
def left_out():
    return Exclusions(NAMES, offset_range_s=2.0)


def tied(*pairs):
    return [RelativePose(a, b, np.eye(3), np.ones(3), 0.0, ((0, 0),), 1.0) for a, b in pairs]


def reasons(left_out):
    return {camera.name: camera.reason for camera in left_out.cameras}


def test_the_group_of_the_reference_is_kept_in_the_given_order(left_out):
    kept = left_out.largest_group([4, 0, 1, 2, 3], tied((2, 4), (0, 1), (1, 3)))
    assert kept == [4, 2]
    assert reasons(left_out)["door"] == (
        "shares nobody's motion with gate, wall; it forms a separate group with desk, roof"
    )


def test_without_company_the_reference_is_left_out_itself(left_out):
    assert left_out.largest_group([0, 1, 2], tied((1, 2))) == [1, 2]
    assert reasons(left_out) == {"door": "shares nobody's motion with desk, wall"}


def test_no_ties_at_all_are_too_little(left_out):
    with pytest.raises(Insufficient, match="agree within 2 s") as end:
        left_out.largest_group([0, 1], [])
    assert end.value.status is Status.INSUFFICIENT_DATA
    assert [camera.name for camera in end.value.uncalibrated] == ["desk"]


def test_a_part_of_a_rig_is_told_by_its_cameras(left_out):
    rig = Rig(np.array([3, 1, 0]), np.tile(np.eye(3), (3, 1, 1)), np.eye(3), np.arange(3.0), 1.0)
    part = left_out.largest_part(rig, Disconnected(((0, 2), (1,))))
    assert part.cameras.tolist() == [3, 0]
    assert list(reasons(left_out)) == ["desk"]
    with pytest.raises(Insufficient, match="could not be matched"):
        left_out.largest_part(rig, Disconnected(((0,), (1,), (2,))))


def test_who_is_tried_again_is_not_left_out(left_out):
    left_out.add([1, 3], "saw nobody")
    left_out.reinstate([3])
    assert reasons(left_out) == {"desk": "saw nobody"}
