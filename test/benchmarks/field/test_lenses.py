"""Lenses that are given wrongly, and what counts as naming them."""

from dataclasses import replace

from benchmarks.field.lenses import FAULTS, Heard, faulty_case, run, said_of_lenses
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark, RemarkCode


def test_a_fault_changes_the_cameras_that_it_names():
    case = faulty_case("all 5 % long", 0)
    assert case.faulty == {"cam0", "cam1", "cam2", "cam3"}
    assert {camera.intrinsics.K[0, 0] for camera in case.recording.cameras} == {1400.0 * 1.05}
    assert faulty_case("half resolution", 0).faulty == {"cam1"}
    assert all(set(fault.cameras) <= case.faulty for fault in FAULTS.values())


def test_only_codes_about_lenses_count():
    found = replace(
        faulty_case("half resolution", 1).truths[0],
        rejections=(Rejection(RejectionReason.PERIODIC_MOTION),),
        remarks=(
            Remark(RemarkCode.RECORD_LONGER),
            Remark(RemarkCode.LENS_DEVIATES, ("cam1",), {"scale": 1.05}),
        ),
    )
    assert said_of_lenses(found) == {"LENS_DEVIATES": {"cam1"}}


def test_half_resolution_is_recognised():
    row = run("half resolution", 1)
    assert isinstance(row, Heard)
    assert row.is_right
    assert "KEYPOINTS_IN_CORNER" in row.said
