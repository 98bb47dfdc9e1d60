"""What a calibration is published as."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import serialize_message
from samples import STAMP, calibration
from scipy.spatial.transform import Rotation
from visualization_msgs.msg import Marker

from stcalib_ros.core.model.rejection import Rejection, RejectionReason
from stcalib_ros.core.monitoring.alarms import State, Verdict
from stcalib_ros.io.topics import SelectedCamera
from stcalib_ros.ros.camera_buffer import Counts
from stcalib_ros.ros.diagnostics import (
    SolverState,
    camera_status,
    complaints,
    load_status,
    solver_status,
    starvation,
)
from stcalib_ros.ros.driver_lenses import DriverState
from stcalib_ros.ros.limits import PROBLEM_S, REPEAT_STARVED_S
from stcalib_ros.ros.load import Load
from stcalib_ros.ros.markers import camera_markers
from stcalib_ros.ros.publishers import transforms
from stcalib_ros.ros.worker import Step

CAMERA = SelectedCamera("cam0", "/a", "/b", None)
COUNTS = Counts(10, 20, 30.0, 0.5, True, 3, 12, 0, 0, "")


def test_transforms_are_the_poses_in_the_reference():
    record = calibration()
    sent = transforms(record, stamp=STAMP, suffix="_found")
    assert [t.child_frame_id for t in sent] == [
        "cam0_optical_frame_found",
        "cam2_optical_frame_found",
    ]
    for transform, camera in zip(sent, (record.cameras[0], record.cameras[2]), strict=True):
        assert (transform.header.frame_id, transform.header.stamp) == ("cam1_optical_frame", STAMP)
        t, q = transform.transform.translation, transform.transform.rotation
        np.testing.assert_array_equal([t.x, t.y, t.z], camera.t_ref_cam)
        np.testing.assert_allclose(
            Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix(), camera.R_ref_cam, atol=1e-12
        )


def test_frusta_open_from_the_camera_along_its_axis():
    record = calibration()
    clear, *markers = camera_markers(record, stamp=STAMP).markers
    assert clear.action == Marker.DELETEALL
    frusta = [m for m in markers if m.type == Marker.LINE_LIST]
    assert [m.text for m in markers if m.ns == "names"] == ["cam0", "cam1", "cam2"]
    for marker, camera in zip(frusta, record.cameras, strict=True):
        points = np.array([[p.x, p.y, p.z] for p in marker.points])
        assert len(points) == 16
        in_camera = (points - camera.t_ref_cam) @ camera.R_ref_cam
        np.testing.assert_allclose(in_camera[0:8:2], 0.0, atol=1e-12)
        corners = in_camera[1:8:2]
        np.testing.assert_allclose(corners[:, 2], corners[0, 2])
        assert corners[0, 2] > 0
        pixels = corners[:, :2] / corners[:, 2:] * 600.0
        np.testing.assert_allclose(pixels, [[0, 0], [640, 0], [640, 480], [0, 480]], atol=1e-9)
        assert len(serialize_message(marker)) > 0


def test_nothing_gives_no_frusta():
    (clear,) = camera_markers(replace(calibration(), cameras=()), stamp=STAMP).markers
    assert clear.action == Marker.DELETEALL


@pytest.mark.parametrize(
    ("counts", "lack", "level", "message"),
    [
        (COUNTS, "", DiagnosticStatus.OK, "receiving"),
        (COUNTS, "waits for poses", DiagnosticStatus.ERROR, "waits for poses"),
        (
            replace(COUNTS, dropped=2, last_problem="too many", dropped_age_s=0.5 * PROBLEM_S),
            "",
            DiagnosticStatus.WARN,
            "dropped messages: too many",
        ),
        (
            replace(COUNTS, dropped=2, last_problem="too many", dropped_age_s=1.5 * PROBLEM_S),
            "",
            DiagnosticStatus.OK,
            "receiving",
        ),
    ],
)
def test_status_of_a_camera(counts, lack, level, message):
    status = camera_status("calibrator", CAMERA, counts, lack, None)
    assert (status.name, status.level, status.message) == (
        "calibrator: camera cam0",
        level,
        message,
    )
    values = {v.key: v.value for v in status.values}
    assert (values["rate_hz"], values["camera_info"]) == ("30.00", "true")
    assert values["watch"] == "off"


def test_a_camera_with_keypoints_that_are_no_pixels_says_what_to_do():
    values = {"least": 0.0, "width": 640, "height": 480}
    fault = Rejection(RejectionReason.KEYPOINTS_NORMALISED, ("cam0",), 0.98, 2.0, "px", (), values)
    lack = starvation(CAMERA, replace(COUNTS, fault=fault), None)
    assert lack.startswith("sends on /a: the keypoints look like fractions")
    assert "multiply them by the image size" in lack
    assert starvation(CAMERA, COUNTS, None) == ""


def test_a_camera_without_a_lens_says_what_to_set_and_the_log_says_it_once():
    fault = Rejection(RejectionReason.LENS_UNKNOWN, ("cam0",), detail="cam0=unknown")
    counts = replace(COUNTS, no_lens=fault)
    lack = starvation(CAMERA, counts, None)
    assert lack.startswith("sends on /b: the lens is unknown")
    assert "set intrinsics to unknown" in lack
    lacks = {"cam0": lack, "cam1": "waits for poses", "cam2": ""}
    starved, no_lens = complaints(lacks, {"cam0": counts, "cam1": COUNTS, "cam2": COUNTS})
    assert starved == ("starved", "camera cam1 waits for poses", REPEAT_STARVED_S)
    assert no_lens == ("no lens of cam0", f"camera cam0 {lack}", math.inf)
    assert complaints({"cam2": ""}, {"cam2": COUNTS}) == ()


def test_a_driver_that_has_not_taken_its_lens_is_a_warning():
    state = DriverState("/set: no answer", failed=True)
    status = camera_status("calibrator", CAMERA, COUNTS, "", None, state)
    assert (status.level, status.message) == (DiagnosticStatus.WARN, "/set: no answer")
    assert {v.key: v.value for v in status.values}["set_camera_info"] == "/set: no answer"
    starved = camera_status("calibrator", CAMERA, COUNTS, "waits for poses", None, state)
    assert (starved.level, starved.message) == (DiagnosticStatus.ERROR, "waits for poses")


@pytest.mark.parametrize(
    ("state", "lack", "level"),
    [
        (State.UNKNOWN, "", DiagnosticStatus.OK),
        (State.OK, "", DiagnosticStatus.OK),
        (State.NO_DETECTIONS, "", DiagnosticStatus.WARN),
        (State.MOVED, "", DiagnosticStatus.ERROR),
        (State.UNMATCHED, "waits for poses", DiagnosticStatus.ERROR),
    ],
)
def test_what_the_watch_says_of_a_camera(state, lack, level):
    verdict = Verdict("cam0", state, 2.0, 0.0, 0.1, 12.0, 4.0)
    status = camera_status("calibrator", CAMERA, COUNTS, lack, verdict)
    values = {v.key: v.value for v in status.values}
    assert status.level == level
    assert values["watch"] == state.value
    assert (values["watch_rotation_deg"], values["watch_clock_ms"]) == ("2.00", "100")
    assert (values["watch_residual_px"], values["watch_promised_px"]) == ("12.0", "4.0")
    expected = lack or (verdict.sentence() if state.alarm else "receiving")
    assert status.message == expected


@pytest.mark.parametrize(
    ("in_force", "last_status", "level"),
    [
        ("run-1", "OK", DiagnosticStatus.OK),
        ("run-1", "DEGENERATE", DiagnosticStatus.OK),
        ("", "DEGENERATE", DiagnosticStatus.ERROR),
        ("", "", DiagnosticStatus.WARN),
    ],
)
def test_status_of_the_solver(in_force, last_status, level):
    step = Step("run-2", "checking the input", 0.25)
    running = solver_status("n", SolverState(step, in_force, "run-1", last_status, "why"))
    idle = solver_status("n", SolverState(None, in_force, "run-1", last_status, "why"))
    assert running.level == idle.level == level
    assert (running.message, idle.message) == ("running run-2: checking the input", "idle")


def test_reasons_of_the_last_run_are_codes_with_their_cameras():
    reasons = (
        Rejection(RejectionReason.RIVAL_SOLUTION),
        Rejection(RejectionReason.DISCONNECTED, ("cam1", "cam2")),
    )
    state = SolverState(None, "", "run-1", "DEGENERATE", "why", last_reasons=reasons)
    values = {pair.key: pair.value for pair in solver_status("n", state).values}
    assert values["last_reasons"] == "RIVAL_SOLUTION, DISCONNECTED (cam1 cam2)"


@pytest.mark.parametrize(
    ("newly_lost", "level", "message"),
    [
        (False, DiagnosticStatus.OK, "keeping up"),
        (
            True,
            DiagnosticStatus.WARN,
            "messages are lost in the network or in the queue (queue_depth), cam1: 3",
        ),
    ],
)
def test_status_of_the_load(newly_lost, level, message):
    load = Load(1800, 0.001, 0.0025, 0.0125, 0.0005, 0.05)
    status = load_status("n", load, {"cam0": 0, "cam1": 3}, newly_lost=newly_lost)
    assert (status.name, status.level, status.message) == ("n: load", level, message)
    assert {v.key: v.value for v in status.values} == {
        "messages_per_minute": "1800",
        "lost": "3",
        "delay_p50_ms": "1.00",
        "delay_p99_ms": "2.50",
        "delay_max_ms": "12.50",
        "hold_p99_ms": "0.50",
        "hold_max_ms": "50.00",
    }
