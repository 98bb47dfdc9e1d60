"""The messages, services and the action are what others were promised: names, types, order."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.msgdefs import definition

PROMISED = {
    "msg/PersonPose3D.msg": """
        uint32 track_id; float32 score; float32[] joints; float32[] keypoints
        float32[] joint_scores""",
    "msg/PersonPose3DArray.msg": """
        std_msgs/Header header; string layout; string[] joint_names; bool rectified; bool metric
        PersonPose3D[] persons""",
    "msg/CameraExtrinsics.msg": """
        std_msgs/Header header; string camera; string child_frame_id
        geometry_msgs/PoseWithCovariance pose; bool metric""",
    "msg/TimeOffset.msg": """
        std_msgs/Header header; string camera; string reference; float64 offset_s
        float64 offset_stddev_s; float64 skew; float64 skew_stddev; builtin_interfaces/Time epoch
        float64 offset_frames; float64 line_time_s; float64 line_time_stddev_s""",
    "msg/PersonAssociation.msg": """
        uint32 person_id; string[] cameras; uint32[] track_ids; float32 reprojection_rms_px
        float32 margin""",
    "msg/PairResidual.msg": """
        string camera_a; string camera_b; uint32 n_matches; float32 median_angle_rad
        float32 epipolar_rms_px""",
    "msg/CalibrationResult.msg": """
        uint8 OK=0; uint8 DEGENERATE=1; uint8 INSUFFICIENT_DATA=2; uint8 NOT_CONVERGED=3
        uint8 CANCELLED=4
        std_msgs/Header header; string run_id; uint8 status; string message
        CameraExtrinsics[] extrinsics; TimeOffset[] time_offsets; PersonAssociation[] persons
        PairResidual[] pairs; float64 reprojection_rms_px; uint32 n_observations; uint32 n_inliers
        builtin_interfaces/Time window_start; builtin_interfaces/Time window_end
        float64 scale_stddev; float64[] joint_covariance; string[] parameter_order
        Rejection[] reasons; CameraIntrinsics[] intrinsics""",
    "msg/CameraIntrinsics.msg": """
        string camera; string knowledge; sensor_msgs/CameraInfo camera_info
        float64 focal_stddev_px; float64 cx_stddev_px; float64 cy_stddev_px
        float64[] radial_stddev""",
    "msg/Rejection.msg": """
        string code; string[] cameras; float64 measured; float64 limit; string unit
        string message""",
    "srv/Recalibrate.srv": """
        string[] cameras; builtin_interfaces/Time start; builtin_interfaces/Time end; bool wait
        ---
        bool accepted; string run_id; stcalib_ros/CalibrationResult result""",
    "srv/SaveCalibration.srv": """
        string path; string format
        ---
        bool success; string message""",
    "action/Calibrate.action": """
        string[] cameras; builtin_interfaces/Time start; builtin_interfaces/Time end
        ---
        stcalib_ros/CalibrationResult result
        ---
        string stage; float32 progress; float64 reprojection_rms_px""",
}


def statements(text: str) -> list[str]:
    code = "\n".join(line.split("#")[0] for line in text.splitlines())
    return [" ".join(line.split()) for line in re.split("[;\n]", code) if line.strip()]


def messages(root: Path) -> list[Path]:
    return sorted((root / "msg").glob("*.msg"))


@pytest.mark.parametrize("path", PROMISED)
def test_fields_are_as_promised(root, path):
    assert statements((root / path).read_text()) == statements(PROMISED[path])


def test_there_are_no_others(root):
    found = [p for folder in ("msg", "srv", "action") for p in (root / folder).iterdir()]
    assert {p.relative_to(root).as_posix() for p in found} == set(PROMISED)


@pytest.mark.parametrize("path", PROMISED)
def test_every_field_is_explained(root, path):
    """A comment directly above, or above the field just before it."""
    explained = False
    for line in (root / path).read_text().splitlines():
        if line.startswith("#"):
            explained = True
        elif not line.strip() or line == "---":
            explained = False
        else:
            named_by_its_type = line.endswith("PersonPose3D[] persons")
            assert explained or "#" in line or named_by_its_type, f"{path}: {line}"


def test_the_constants_of_status_are_those_of_the_core():
    constants = re.findall(r"^uint8 (\w+)=(\d+)", definition("CalibrationResult"), re.MULTILINE)
    assert {name: int(number) for name, number in constants} == {s.name: s.value for s in Status}


def test_definitions_are_the_message_files(root):
    assert {p.stem: definition(p.stem) for p in messages(root)} == {
        p.stem: p.read_text() for p in messages(root)
    }


def test_an_unknown_message_is_named_with_where_it_was_looked_for(root):
    with pytest.raises(InputError, match=f"no definition of message 'Nothing' in .*{root}/msg"):
        definition("Nothing")
